"""Text that a terminal would obey, put into everything that text can be put into."""

import re
from collections.abc import Iterable, Iterator
from typing import Any, cast

from pydantic import ValidationError

from pa_console.schema.events.event import Event

PIECES = (
    "\x1b]52;c;aGk=\x07", "\x1b[31;5m", "\x1bPq\x1b\\", "\x9b31m", "\x9d52;c;aGk=\x9c",
    "\x85", "\r", "\x08", "\x0c", "\x7f", "\x00", "\u061c", "\u200b", "\u200d", "\u200e", "\u2028",
    "\u202e", "\u2060", "\u2066", "\ufeff", "\u00ad", "\U000e0041", "\U000e007f",
)  # fmt: skip
PAYLOAD = "".join(PIECES) + "[/x][bold red]]"
_OWN = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
"""What the terminal library writes by itself."""
_RAW = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u00ad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff"
    "\U000e0000-\U000e007f\ud800-\udfff]"
)


def raw(written: str) -> list[str]:
    """Return what of the payload, or of anything like it, stands in what was written."""
    found = [piece for piece in PIECES if piece in written]
    return found + [ascii(match) for match in _RAW.findall(_OWN.sub("", written))]


def hostile(events: Iterable[Event]) -> list[Event]:
    """Return the events with the payload after every text that may be any text."""
    return [_hostile_event(event) for event in events]


def _hostile_event(event: Event) -> Event:
    document = event.model_dump(mode="json")
    for place, key in list(_texts(document["data"])):
        before = place[key]
        place[key] = before + PAYLOAD
        try:
            Event.model_validate(document, strict=False)
        except ValidationError:
            place[key] = before
    return Event.model_validate(document, strict=False)


def _texts(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield where every text stands but ids and what events are told apart by."""
    keys = cast(dict[str, Any], value) if isinstance(value, dict) else range(len(value))
    for key in list[Any](keys):
        if isinstance(value[key], str):
            if key not in ("kind", "session", "id", "mission_id", "rule_id", "world", "rules"):
                yield value, key
        elif isinstance(value[key], dict | list):
            yield from _texts(value[key])
