"""Reads one event that a server sent: its uid, type, times and place, as far as they make sense.

A document type is refused, and with it every entity, so that no text grows while it is read.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import cast
from xml.etree.ElementTree import Element, ParseError

from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from pa_console.schema.events.tak import MOST_CALLSIGN, MOST_UID, ClaimedAffiliation, ClaimedKind
from pa_console.schema.text.visible_text import visible_line
from pa_console.tak.cot_event import DELETE, UNKNOWN

_PARSE = cast(Callable[..., Element], ElementTree.fromstring)
_TYPE = re.compile(r"[A-Za-z0-9.-]{1,64}", re.ASCII)
_AFFILIATIONS: dict[str, ClaimedAffiliation] = {
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
"""The battle dimension of MIL-STD-2525 and what follows it; the first that fits counts."""


@dataclass(frozen=True)
class HeardEvent:
    """What an event says. Latitude and longitude are degrees of WGS-84, `ce` is in metres.

    `about` is the uid of what the event takes off the map, empty for any other event. `uid` and
    `callsign` are one line each, with every character that a terminal would obey as its escape.
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
        """The uid of what the event tells of."""
        return self.about or self.uid

    @property
    def places(self) -> bool:
        """Whether it says where something is."""
        return self.type.startswith("a-")

    @property
    def affiliation(self) -> ClaimedAffiliation:
        """How that stands to the sender, as it says."""
        return _AFFILIATIONS.get(self.type.split("-")[1], "other") if self.places else "other"

    @property
    def what(self) -> ClaimedKind:
        """What that is, as the sender says."""
        parts = self.type.split("-", 2)
        function = f"{parts[2]}-" if len(parts) == 3 else ""
        for sign, kind in _KINDS:
            if function.startswith(f"{sign}-"):
                return kind
        return "object"


def read_event(document: bytes) -> HeardEvent | None:
    """Return what an event says, None for what is no event, or none that makes sense."""
    try:
        root = _PARSE(document, forbid_dtd=True)
        if root.tag != "event":
            return None
        return _event(root)
    except (ParseError, DefusedXmlException, ValueError, OverflowError, LookupError):
        return None


def _event(root: Element) -> HeardEvent:
    """Raise ValueError for what makes no sense."""
    uid, type_, point = root.get("uid", ""), root.get("type", ""), root.find("point")
    if not uid or point is None or _TYPE.fullmatch(type_) is None:
        raise ValueError("no uid, no type or no point")
    contact, link = root.find("detail/contact"), root.find("detail/link")
    callsign = contact.get("callsign", "") if contact is not None else ""
    about = link.get("uid", "") if type_ == DELETE and link is not None else ""
    ce = float(point.get("ce", "nan"))
    return HeardEvent(
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
        raise ValueError("too long a uid")
    return shown


def _degrees(text: str, most: float) -> float:
    value = float(text)
    if not math.isfinite(value) or abs(value) > most:
        raise ValueError(f"{text} is no angle")
    return value


def _moment(text: str) -> datetime:
    """Read a moment; one without a zone is in UTC."""
    found = datetime.fromisoformat(text)
    return (found if found.tzinfo is not None else found.replace(tzinfo=UTC)).astimezone(UTC)
