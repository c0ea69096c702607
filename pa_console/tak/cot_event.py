"""A Cursor on Target event, as XML of version 2.0."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal
from xml.etree.ElementTree import Element, SubElement, tostring

from pa_console.schema.text.visible_text import visible

UNKNOWN = 9_999_999.0
"""What the schema writes for a height or an error that nobody knows, in metres."""
DELETE, PING = "t-x-d-d", "t-x-c-t"
How = Literal["m-g", "m-s"]
"""How a position came about: told by the machine itself, or simulated."""


@dataclass(frozen=True)
class CotPoint:
    """A place in degrees of WGS-84; height, circular and linear error in metres."""

    latitude: float = 0.0
    longitude: float = 0.0
    hae: float = UNKNOWN
    ce: float = UNKNOWN
    le: float = UNKNOWN


@dataclass(frozen=True)
class CotEvent:
    """What a TAK map is told: `type` of thing `uid` was at `point` at `time`, until `stale`.

    `about` is the uid of the thing that is told of, where the event has one of its own.
    """

    uid: str
    type: str
    time: datetime
    stale: datetime
    point: CotPoint = CotPoint()
    how: How = "m-g"
    detail: tuple[Element, ...] = ()
    about: str = ""

    @property
    def subject(self) -> str:
        """The uid of what the event tells of: a later event with the same takes its place."""
        return self.about or self.uid

    def xml(self) -> bytes:
        """Return the event as one line of UTF-8."""
        event = Element(
            "event",
            version="2.0",
            uid=self.uid,
            type=self.type,
            how=self.how,
            time=stamp(self.time),
            start=stamp(self.time),
            stale=stamp(self.stale),
        )
        at = self.point
        place = {"lat": f"{at.latitude:.8f}", "lon": f"{at.longitude:.8f}"}
        rest = {name: f"{value:.2f}" for name, value in (("hae", at.hae), ("ce", at.ce))}
        SubElement(event, "point", place | rest | {"le": f"{at.le:.2f}"})
        SubElement(event, "detail").extend(self.detail)
        return tostring(event, encoding="utf-8", xml_declaration=False) + b"\n"


def stamp(moment: datetime) -> str:
    """Write a moment as CoT does: UTC, to the millisecond."""
    return moment.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"


def element(tag: str, attributes: Mapping[str, str], text: str = "") -> Element:
    """Return one element of a detail; what XML or a terminal cannot take is written as escapes."""
    made = Element(tag, {name: visible(value) for name, value in attributes.items()})
    made.text = visible(text) or None
    return made


def deletion(uid: str, type_: str, now: datetime) -> CotEvent:
    """Return what takes the thing `uid` off every map."""
    link = element("link", {"uid": uid, "relation": "none", "type": type_})
    detail = (link, Element("__forcedelete"))
    return CotEvent(f"{uid}.deleted", DELETE, now, now, detail=detail, about=uid)


def ping(uid: str, now: datetime, stale: datetime) -> CotEvent:
    """Return what a server answers, so that a connection that is dead is found out."""
    return CotEvent(f"{uid}-ping", PING, now, stale)
