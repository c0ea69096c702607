"""The position of a world on the earth: conversion of its metres to WGS-84 degrees and back."""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import cast

import pymap3d
from pydantic import ValidationError

from pa_console.schema.base import Point
from pa_console.schema.world import Origin, World

Triple = tuple[float, float, float]
_TO_GEODETIC = cast(Callable[..., Triple], pymap3d.enu2geodetic)
_TO_PLANE = cast(Callable[..., Triple], pymap3d.geodetic2enu)
CURVED_M = 1000.0
"""The depth of the ground below the plane at 110 km; points farther away do not count as near."""
_CACHED = 8192


class Geography:
    """The conversion of a world's metres to WGS-84 and back, from the origin of the world.

    The world is the plane that touches the ellipsoid at its origin; `pymap3d` does the calculation.
    """

    def __init__(self, origin: Origin) -> None:
        """Set `origin`, the position of (0, 0) and the bearing of the y axis."""
        self.altitude = origin.altitude
        """The height of the ground above the ellipsoid in metres, or None if unknown."""
        self._at = (origin.latitude, origin.longitude, origin.altitude or 0.0)
        self._bearing = origin.bearing
        turn = math.radians(origin.bearing)
        self._cos, self._sin = math.cos(turn), math.sin(turn)
        self.degrees = lru_cache(_CACHED)(self._degrees)
        """A function that returns (latitude, longitude) of a point in metres. Results are cached,
        because most of a team stands still."""

    def _degrees(self, point: Point) -> tuple[float, float]:
        x, y = point
        east, north = x * self._cos + y * self._sin, y * self._cos - x * self._sin
        latitude, longitude, _ = _TO_GEODETIC(east, north, 0.0, *self._at)
        return float(latitude), float(longitude)

    def metres(self, latitude: float, longitude: float) -> Point:
        """Return the point at (latitude, longitude) on the ground."""
        east, north, _ = _TO_PLANE(latitude, longitude, self._at[2], *self._at)
        x, y = east * self._cos - north * self._sin, east * self._sin + north * self._cos
        return float(x), float(y)

    def near(self, latitude: float, longitude: float) -> Point | None:
        """Return the point as `metres` does; None if it is deeper than CURVED_M below the plane."""
        *_, up = _TO_PLANE(latitude, longitude, self._at[2], *self._at)
        return self.metres(latitude, longitude) if up > -CURVED_M else None

    def course(self, heading_deg: float) -> float:
        """Return a heading (0 along the x axis) in degrees clockwise from true north."""
        return (90.0 - heading_deg + self._bearing) % 360.0

    def heading(self, course_deg: float) -> float:
        """Return the heading (0 along the x axis, 90 along the y axis) of a course."""
        return (90.0 - course_deg + self._bearing) % 360.0


def origin_of(text: str) -> Origin:
    """Parse `LATITUDE,LONGITUDE[,BEARING[,ALTITUDE]]`; raises ValueError with the problem."""
    names = ("latitude", "longitude", "bearing", "altitude")
    parts = text.split(",")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if not 2 <= len(numbers) <= len(names):
        raise ValueError(
            f"origin {text}: expected LATITUDE,LONGITUDE[,BEARING[,ALTITUDE]], such as 2.0,-30.0"
        )
    try:
        return Origin(**dict(zip(names, numbers, strict=False)))
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"origin {text}: {first['loc'][0]}: {first['msg']}") from None


def geography_of(world: World, origin: str, options: str) -> Geography:
    """Return the geography of `world`; a non-empty `origin` overrides that of its file.

    Raises ValueError for an invalid origin, and for a world without an origin. The message for the
    latter names `options`, the options that give an origin.
    """
    at = origin_of(origin) if origin else world.origin
    if at is None:
        raise ValueError(
            f"the world {world.name!r} has no position on the earth: give its origin as "
            f"LATITUDE,LONGITUDE ({options}), or as 'origin' in its file"
        )
    return Geography(at)
