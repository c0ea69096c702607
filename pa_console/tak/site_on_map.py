"""A site on a TAK map: its place on the earth, its names, and drawings of its ground."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from xml.etree.ElementTree import Element

from pydantic import TypeAdapter, ValidationError

from pa_console.schema.base import Name, Point
from pa_console.schema.world import World
from pa_console.sim.worlds.geography import Geography
from pa_console.tak.cot_event import UNKNOWN, CotEvent, CotPoint, How, deletion, element

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
