"""Cursor on Target events as XML, version 2.0: written for a TAK map, read from a server."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal, cast
from xml.etree.ElementTree import Element, ParseError, SubElement, tostring

from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from pa_console.schema.events.session import (
    MOST_CALLSIGN,
    MOST_UID,
    ClaimedAffiliation,
    ClaimedKind,
)
from pa_console.schema.text import visible, visible_line

UNKNOWN = 9_999_999.0
"""The schema's value for an unknown height or error, in metres."""
DELETE, PING = "t-x-d-d", "t-x-c-t"
How = Literal["m-g", "m-s"]
"""The source of a position: reported by the machine itself, or simulated."""
BEGIN, END = b"<event", b"</event>"
MOST_BYTES = 65_536
"""The largest event that is read, in bytes; the schema's own examples have a tenth of them."""


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
    """An event for a TAK map: `uid`, of `type`, was at `point` at `time`; valid until `stale`.

    `about` is the uid of the thing if the event has a uid of its own.
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
        """The uid of the thing; a later event with the same subject replaces this one."""
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
    """Return a moment in CoT form: UTC, to the millisecond."""
    return moment.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"


def element(tag: str, attributes: Mapping[str, str], text: str = "") -> Element:
    """Return one element of a detail; unprintable characters are escaped."""
    made = Element(tag, {name: visible(value) for name, value in attributes.items()})
    made.text = visible(text) or None
    return made


def deletion(uid: str, type_: str, now: datetime) -> CotEvent:
    """Return the event that removes the thing `uid` from every map."""
    link = element("link", {"uid": uid, "relation": "none", "type": type_})
    detail = (link, Element("__forcedelete"))
    return CotEvent(f"{uid}.deleted", DELETE, now, now, detail=detail, about=uid)


def ping(uid: str, now: datetime, stale: datetime) -> CotEvent:
    """Return an event that a server answers, which reveals a dead connection."""
    return CotEvent(f"{uid}-ping", PING, now, stale)


class EventStream:
    """A stream of bytes, cut into complete events; `broken` counts those that were too long."""

    def __init__(self, most: int = MOST_BYTES) -> None:
        """Keep at most `most` bytes of an event without its end."""
        self._most = most
        self._rest = bytearray()
        self._skipping = False
        self.broken = 0

    def feed(self, data: bytes) -> list[bytes]:
        """Return the events that end in `data`, each from `<event` to `</event>`."""
        events: list[bytes] = []
        searched = max(len(self._rest) - len(END) + 1, 0)
        self._rest += data
        begin = 0
        while (end := self._rest.find(END, max(begin, searched))) >= 0:
            document = bytes(self._rest[begin : end + len(END)])
            begin = end + len(END)
            if self._skipping or len(document) > self._most:
                self.broken += not self._skipping
                self._skipping = False
            elif (start := document.find(BEGIN)) >= 0:
                events.append(document[start:])
        del self._rest[:begin]
        if len(self._rest) > self._most:
            self.broken += not self._skipping
            self._skipping = True
            del self._rest[: -len(END) + 1]
        return events


_PARSE = cast(Callable[..., Element], ElementTree.fromstring)
_TYPE = re.compile(r"[A-Za-z0-9.-]{1,64}", re.ASCII)
AFFILIATIONS: dict[str, ClaimedAffiliation] = {
    "f": "friend",
    "a": "assumed friend",
    "n": "neutral",
    "u": "unknown",
    "p": "pending",
    "s": "suspect",
    "h": "hostile",
}
_KINDS: tuple[tuple[str, ClaimedKind], ...] = (
    ("A", "aircraft"),
    ("G-U", "ground unit"),
    ("G-E-V", "vehicle"),
    ("G-I", "installation"),
    ("G", "ground object"),
    ("S", "vessel"),
    ("U", "submarine"),
    ("P", "spacecraft"),
    ("F", "special forces"),
)
"""Battle dimension and function of MIL-STD-2525; the first match counts."""


@dataclass(frozen=True)
class ReceivedEvent:
    """An event from a server; latitude and longitude are degrees of WGS-84, `ce` is in metres.

    `about` is the uid of the thing that the event removes, '' for any other event. `uid` and
    `callsign` are one line each, with terminal control characters escaped.
    """

    uid: str
    type: str
    time: datetime
    stale: datetime
    latitude: float
    longitude: float
    ce: float | None = None
    callsign: str = ""
    about: str = ""

    @property
    def subject(self) -> str:
        """The uid of the thing that the event is about."""
        return self.about or self.uid

    @property
    def has_place(self) -> bool:
        """True if the event reports the position of a thing."""
        return self.type.startswith("a-")

    @property
    def affiliation(self) -> ClaimedAffiliation:
        """The affiliation of the thing, as its sender claims it."""
        return AFFILIATIONS.get(self.type.split("-")[1], "other") if self.has_place else "other"

    @property
    def what(self) -> ClaimedKind:
        """The kind of the thing, as its sender claims it."""
        parts = self.type.split("-", 2)
        function = f"{parts[2]}-" if len(parts) == 3 else ""
        for sign, kind in _KINDS:
            if function.startswith(f"{sign}-"):
                return kind
        return "object"


def read_event(document: bytes) -> ReceivedEvent | None:
    """Return the event in `document`, or None if it is invalid.

    A document type is refused, because its entities could grow without limit when they are read.
    """
    try:
        root = _PARSE(document, forbid_dtd=True)
        if root.tag != "event":
            return None
        return _event(root)
    except (ParseError, DefusedXmlException, ValueError, OverflowError, LookupError):
        return None


def _event(root: Element) -> ReceivedEvent:
    """Return the event in `root`; raise ValueError for an invalid value."""
    uid, type_, point = root.get("uid", ""), root.get("type", ""), root.find("point")
    if not uid or point is None or _TYPE.fullmatch(type_) is None:
        raise ValueError("no uid, no type or no point")
    contact, link = root.find("detail/contact"), root.find("detail/link")
    callsign = contact.get("callsign", "") if contact is not None else ""
    about = link.get("uid", "") if type_ == DELETE and link is not None else ""
    ce = float(point.get("ce", "nan"))
    return ReceivedEvent(
        _uid(uid),
        type_,
        _moment(root.get("time", "")),
        _moment(root.get("stale", "")),
        _degrees(point.get("lat", ""), 90.0),
        _degrees(point.get("lon", ""), 180.0),
        ce if 0.0 <= ce < UNKNOWN else None,
        visible_line(" ".join(callsign.split())[:MOST_CALLSIGN])[:MOST_CALLSIGN],
        _uid(about),
    )


def _uid(text: str) -> str:
    shown = visible_line(text)
    if len(shown) > MOST_UID:
        raise ValueError("the uid is too long")
    return shown


def _degrees(text: str, most: float) -> float:
    value = float(text)
    if not math.isfinite(value) or abs(value) > most:
        raise ValueError(f"{text} is not an angle")
    return value


def _moment(text: str) -> datetime:
    """Parse a moment; one without a time zone is in UTC."""
    time = datetime.fromisoformat(text)
    return (time if time.tzinfo is not None else time.replace(tzinfo=UTC)).astimezone(UTC)
