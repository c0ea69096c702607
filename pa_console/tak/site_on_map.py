"""What a site is called on a TAK map, and its ground as drawings: perimeter, zones, frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from xml.etree.ElementTree import Element

from pydantic import TypeAdapter, ValidationError

from pa_console.schema.base import Name, Point
from pa_console.schema.world import World
from pa_console.tak.cot_event import UNKNOWN, CotEvent, CotPoint, How, deletion, element
from pa_console.tak.geography import Geography

SHAPE, SPOT = "u-d-f", "b-m-p-s-m"
SPOT_ICONS = "COT_MAPPING_SPOTMAP"
"""Where ATAK looks for the sign of a point."""
WHITE, RED, CYAN = 0xFFFFFFFF, 0xFFFF0000, 0xFF00FFFF
FILLED = 0x40FFFFFF
"""Leaves a quarter of a colour, to fill with."""


@dataclass(frozen=True)
class SiteOnMap:
    """A world, where it is, and how its things are called on the map.

    `name` begins every uid. A `replay` is told from what happens now by uid, callsign and `how`.
    """

    world: World
    geography: Geography
    name: str
    replay: bool = False

    def uid(self, *parts: str) -> str:
        """Return the uid of a thing of this site: always the same for the same thing."""
        return ".".join(("pa-console-replay" if self.replay else "pa-console", self.name, *parts))

    def callsign(self, name: str) -> str:
        """Return what is written beside a thing."""
        return f"REPLAY {name}" if self.replay else name

    @property
    def how(self) -> How:
        """How the positions came about."""
        return "m-s" if self.replay else "m-g"

    def point(self, at: Point, ce: float = UNKNOWN, *, flies: bool = False) -> CotPoint:
        """Return a place; whoever flies does so at a height that nobody knows."""
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
        """Return what takes the ground off the map."""
        return [deletion(event.uid, event.type, now) for event in self.ground(now, now)]


def site_name(text: str) -> str:
    """Return the name of a site; raises ValueError for what is none."""
    try:
        return TypeAdapter[str](Name).validate_python(text)
    except ValidationError:
        raise ValueError(f"--name {text}: letters, digits and _ after a letter") from None


def signed(argb: int) -> str:
    """Write a colour as ATAK does: 32 bits with a sign."""
    return str(argb - (1 << 32) if argb >= 1 << 31 else argb)
