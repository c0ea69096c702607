"""Turns a world's metres into WGS-84 and back, by the origin of the world.

The world is the plane that touches the ellipsoid at its origin; `pymap3d` computes exactly on it.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import cast

import pymap3d
from pydantic import ValidationError

from pa_console.schema.base import Point
from pa_console.schema.world import Origin

Triple = tuple[float, float, float]
_TO_GEODETIC = cast(Callable[..., Triple], pymap3d.enu2geodetic)
_TO_PLANE = cast(Callable[..., Triple], pymap3d.geodetic2enu)
CURVED_M = 1000.0
"""How far below the plane the ground is 110 km away; beyond it nothing is near."""
KNOWN = 8192
"""So many places are remembered: most of a team stands still."""


class Geography:
    """Where the points of a world are on the earth."""

    def __init__(self, origin: Origin) -> None:
        """`origin` is where (0, 0) is, and which way the y axis points."""
        self.altitude = origin.altitude
        """Metres of the ground above the ellipsoid, None where nobody said."""
        self._at = (origin.latitude, origin.longitude, origin.altitude or 0.0)
        self._bearing = origin.bearing
        turn = math.radians(origin.bearing)
        self._cos, self._sin = math.cos(turn), math.sin(turn)
        self.degrees = lru_cache(KNOWN)(self._degrees)
        """Returns (latitude, longitude) of a point in metres."""

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
        """Return the point likewise, None where the earth has curved away from the plane."""
        *_, up = _TO_PLANE(latitude, longitude, self._at[2], *self._at)
        return self.metres(latitude, longitude) if up > -CURVED_M else None

    def course(self, heading_deg: float) -> float:
        """Return degrees from true north, clockwise, of a heading (0 along the x axis)."""
        return (90.0 - heading_deg + self._bearing) % 360.0


def origin_of(text: str) -> Origin:
    """Read `LATITUDE,LONGITUDE[,BEARING[,ALTITUDE]]`; raises ValueError saying what is wrong."""
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
