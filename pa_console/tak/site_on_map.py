"""A site on a TAK map: its place on the earth, its names, and drawings of its ground."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from typing import cast
from xml.etree.ElementTree import Element

import pymap3d
from pydantic import TypeAdapter, ValidationError

from pa_console.schema.base import Name, Point
from pa_console.schema.world import Origin, World
from pa_console.tak.cot_event import UNKNOWN, CotEvent, CotPoint, How, deletion, element

Triple = tuple[float, float, float]
_TO_GEODETIC = cast(Callable[..., Triple], pymap3d.enu2geodetic)
_TO_PLANE = cast(Callable[..., Triple], pymap3d.geodetic2enu)
CURVED_M = 1000.0
"""The depth of the ground below the plane at a distance of 110 km; nothing beyond is near."""
_CACHED = 8192


class Geography:
    """The conversion of a world's metres into WGS-84 and back, by the origin of the world.

    The world is the plane that touches the ellipsoid at its origin; `pymap3d` computes on it.
    """

    def __init__(self, origin: Origin) -> None:
        """`origin` is the place of (0, 0) and the bearing of the y axis."""
        self.altitude = origin.altitude
        """Metres of the ground above the ellipsoid, None if unknown."""
        self._at = (origin.latitude, origin.longitude, origin.altitude or 0.0)
        self._bearing = origin.bearing
        turn = math.radians(origin.bearing)
        self._cos, self._sin = math.cos(turn), math.sin(turn)
        self.degrees = lru_cache(_CACHED)(self._degrees)
        """A function that returns (latitude, longitude) of a point in metres.

        Places are cached: most of a team stands still.
        """

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
        """Return the same point, or None if the earth has curved away from the plane there."""
        *_, up = _TO_PLANE(latitude, longitude, self._at[2], *self._at)
        return self.metres(latitude, longitude) if up > -CURVED_M else None

    def course(self, heading_deg: float) -> float:
        """Return a heading (0 along the x axis) as degrees clockwise from true north."""
        return (90.0 - heading_deg + self._bearing) % 360.0


def origin_of(text: str) -> Origin:
    """Read `LATITUDE,LONGITUDE[,BEARING[,ALTITUDE]]`; raise ValueError that names the problem."""
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


SHAPE, SPOT = "u-d-f", "b-m-p-s-m"
SPOT_ICONS = "COT_MAPPING_SPOTMAP"
"""The icon set of ATAK for points."""
WHITE, RED, CYAN = 0xFFFFFFFF, 0xFFFF0000, 0xFF00FFFF
FILLED = 0x40FFFFFF
"""A mask that leaves a quarter of a colour's opacity, for fills."""


@dataclass(frozen=True)
class SiteOnMap:
    """A world, its place on the earth, and the names of its things on the map.

    `name` is the start of every uid. A `replay` differs from a live session in uid, callsign and
    `how`.
    """

    world: World
    geography: Geography
    name: str
    replay: bool = False

    def uid(self, *parts: str) -> str:
        """Return the uid of a thing of this site, the same every time."""
        return ".".join(("pa-console-replay" if self.replay else "pa-console", self.name, *parts))

    def callsign(self, name: str) -> str:
        """Return the label of a thing."""
        return f"REPLAY {name}" if self.replay else name

    @property
    def how(self) -> How:
        """The source of the positions."""
        return "m-s" if self.replay else "m-g"

    def point(self, at: Point, ce: float = UNKNOWN, *, flies: bool = False) -> CotPoint:
        """Return a place; the height of a flying asset is unknown."""
        latitude, longitude = self.geography.degrees(at)
        altitude = self.geography.altitude
        hae = UNKNOWN if flies or altitude is None else altitude
        return CotPoint(latitude, longitude, hae, ce)

    def shape(
        self,
        uid: str,
        callsign: str,
        points: Sequence[Point],
        colour: int,
        until: tuple[datetime, datetime],
        *,
        closed: bool = False,
        remarks: str = "",
    ) -> CotEvent:
        """Return a line, or a polygon that is `closed`; `until` is (time, stale)."""
        way = [*points, points[0]] if closed else list(points)
        detail: list[Element] = []
        for latitude, longitude in map(self.geography.degrees, way):
            detail.append(element("link", {"point": f"{latitude:.8f},{longitude:.8f}"}))
        detail.append(element("strokeColor", {"value": signed(colour)}))
        detail.append(element("strokeWeight", {"value": "3.0"}))
        if closed:
            detail.append(element("fillColor", {"value": signed(colour & FILLED)}))
        detail.append(element("labels_on", {"value": "true"}))
        detail.append(element("contact", {"callsign": self.callsign(callsign)}))
        detail.append(element("remarks", {}, remarks))
        middle = (
            sum(x for x, _ in points) / len(points),
            sum(y for _, y in points) / len(points),
        )
        at = self.point(middle if closed else points[0])
        return CotEvent(uid, SHAPE, *until, at, self.how, tuple(detail))

    def ground(self, now: datetime, stale: datetime) -> list[CotEvent]:
        """Return the perimeter, the zones and the frames."""
        until, world = (now, stale), self.world
        area = self.uid("perimeter")
        drawn = [self.shape(area, world.title, world.perimeter, CYAN, until, closed=True)]
        for name, zone in world.zones.items():
            uid, says = self.uid("zone", name), f"{zone.kind} zone"
            drawn.append(self.shape(uid, name, zone.polygon, RED, until, closed=True, remarks=says))
        for name, frame in world.frames.items():
            detail = (
                element("contact", {"callsign": self.callsign(name)}),
                element("color", {"argb": signed(WHITE)}),
                element("usericon", {"iconsetpath": f"{SPOT_ICONS}/{SPOT}/{signed(WHITE)}"}),
                element("remarks", {}, f"{frame.kind}, {frame.radius_m:g} m around this point"),
            )
            at = self.point(frame.at, frame.radius_m)
            drawn.append(CotEvent(self.uid("frame", name), SPOT, *until, at, self.how, detail))
        return drawn

    def ground_deleted(self, now: datetime) -> list[CotEvent]:
        """Return the events that remove the ground from the map."""
        return [deletion(event.uid, event.type, now) for event in self.ground(now, now)]


def site_name(text: str) -> str:
    """Return `text` as the name of a site; raise ValueError for an invalid one."""
    try:
        return TypeAdapter[str](Name).validate_python(text)
    except ValidationError:
        raise ValueError(f"--name {text}: letters, digits and _ after a letter") from None


def signed(argb: int) -> str:
    """Return a colour in the form of ATAK: a signed number of 32 bits."""
    return str(argb - (1 << 32) if argb >= 1 << 31 else argb)
