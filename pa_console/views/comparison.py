"""Comparison of two recordings: the first differing event, and its differences.

Kind, mission, simulation tick and content of events are compared. Values that differ between two
runs of the same session are ignored: session ids, times of day, hashes other than those that pin a
session, and measurements of the machine (seconds, tokens).
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from itertools import zip_longest
from typing import cast

from pydantic import BaseModel

from pa_console.schema.events.event import Event, Payload, SessionStarted
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Metrics, Mission
from pa_console.schema.rule import SHORT, RulesSeal
from pa_console.session.recording import Recording
from pa_console.views.event_words import event_in_words, kind_in_words

ABSENT = "(absent)"
TICK = "tick"
ENDED = "the recording ends here"
_PINS = frozenset(("world_sha256", "rules_sha256", "model_sha256", "scenario_sha256"))
"""The fields with hashes of the files that a session was started with."""
_COUNTS = frozenset(("attempts", "plans", "halts"))
_LEFT_OUT: dict[type[BaseModel], frozenset[str]] = {
    SessionStarted: frozenset(("session", "version", "packages")),
    Mission: frozenset(("created",)),
    Metrics: frozenset(Metrics.model_fields) - _COUNTS,
    Usage: frozenset(Usage.model_fields),
    RulesSeal: frozenset(("key", "signer")),
}
_NAMES = ("rule_id", "id")
_STEP = 4096


@dataclass(frozen=True)
class ChangedValue:
    """One value that differs; `path` is its place, as in `plan.actions[0].command`."""

    path: str
    a: str
    b: str


@dataclass(frozen=True)
class EventDifference:
    """Two differing events, counted from 0; a number past the end means that there is no event."""

    a: int
    b: int
    changes: tuple[ChangedValue, ...]


@dataclass(frozen=True)
class SessionComparison:
    """The differences at the start of two sessions, and the first event that differs.

    If that event is telemetry, or differs only in its tick, `beyond` is the first event with
    another difference, or None if there is none.
    """

    started: tuple[ChangedValue, ...]
    first: EventDifference | None
    beyond: EventDifference | None

    @property
    def same(self) -> bool:
        """True if the sessions do not differ."""
        return not self.started and self.first is None


def compare_sessions(
    a: Recording, b: Recording, progress: Callable[[int, int], None] | None = None
) -> SessionComparison:
    """Compare two recordings event by event.

    `progress` receives the number of compared events and the total number of events.
    Raises LogError if a log can no longer be read.
    """
    began = int(all(len(r) and isinstance(r[0].data, SessionStarted) for r in (a, b)))
    started = _changes(_meaning(a[0])["data"], _meaning(b[0])["data"]) if began else ()
    most = max(len(a), len(b))
    first = None
    for index in range(began, most):
        if progress is not None and index % _STEP == 0:
            progress(index, most)
        if index >= min(len(a), len(b)) or not _same(a, index, b, index, ticks=True):
            first = _difference(a, index, b, index)
            break
    beyond = None
    if first is not None and _is_timing(a, b, first):
        beyond = _beyond(a, b, first.a)
    return SessionComparison(started, first, beyond)


def _is_timing(a: Recording, b: Recording, difference: EventDifference) -> bool:
    """Return True for a difference in telemetry, in the tick only, or in length."""
    if difference.a >= len(a) or difference.b >= len(b):
        return True
    telemetry = a.timeline.is_telemetry(difference.a) or b.timeline.is_telemetry(difference.b)
    return telemetry or [change.path for change in difference.changes] == [TICK]


def _beyond(a: Recording, b: Recording, first: int) -> EventDifference | None:
    """Return the first difference from event `first` on that is not in telemetry or ticks."""
    events = (r.timeline.without_telemetry(first, len(r)) for r in (a, b))
    for at, bt in zip_longest(*events):
        if at is None or bt is None or not _same(a, at, b, bt, ticks=False):
            return _difference(a, len(a) if at is None else at, b, len(b) if bt is None else bt)
    return None


def _same(a: Recording, at: int, b: Recording, bt: int, *, ticks: bool) -> bool:
    """Return True if two events mean the same; identical texts, the usual case, are not parsed."""
    if ticks and a.timeline.ticks[at] != b.timeline.ticks[bt]:
        return False
    return a.content(at) == b.content(bt) or _meaning(a[at]) == _meaning(b[bt])


def _difference(a: Recording, at: int, b: Recording, bt: int) -> EventDifference:
    """Return the difference of two events, one of which may be past the end."""
    first = a[at] if at < len(a) else None
    second = b[bt] if bt < len(b) else None
    if first is None or second is None or first.data.kind != second.data.kind:
        change = ChangedValue("event", _summary(first), _summary(second))
        return EventDifference(at, bt, (change,))
    changes = _changes(_meaning(first), _meaning(second))
    ticks = a.timeline.ticks[at], b.timeline.ticks[bt]
    if ticks[0] != ticks[1]:
        changes = (ChangedValue(TICK, str(ticks[0]), str(ticks[1])), *changes)
    return EventDifference(at, bt, changes)


def _summary(event: Event | None) -> str:
    if event is None:
        return ENDED
    return f"{kind_in_words(event.data.kind)} {event_in_words(event.data)}".strip()


def _meaning(event: Event) -> dict[str, object]:
    """Return the compared fields of an event, except its tick, as plain values."""
    return {"mission": event.mission, "data": _plain(event.data)}


def _plain(value: object) -> object:
    if isinstance(value, BaseModel):
        left_out = _LEFT_OUT.get(type(value), frozenset())
        pins = _PINS if isinstance(value, SessionStarted) else frozenset[str]()
        return {
            name: getattr(value, name)[:SHORT] if name in pins else _plain(getattr(value, name))
            for name in type(value).model_fields
            if name not in left_out
            and (name in pins or not name.endswith("sha256"))
            and not (name == "seconds" and isinstance(value, Payload))
        }
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in cast(dict[object, object], value).items()}
    if isinstance(value, tuple | list):
        return [_plain(part) for part in cast(list[object], value)]
    return value


def _changes(a: object, b: object, path: str = "") -> tuple[ChangedValue, ...]:
    """Return every value that differs, in the order of the fields."""
    if isinstance(a, dict) and isinstance(b, dict):
        first, second = cast(dict[str, object], a), cast(dict[str, object], b)
        names = dict.fromkeys((*first, *second))
        parts = [
            _changes(first.get(name, ABSENT), second.get(name, ABSENT), _below(path, name))
            for name in names
        ]
        return tuple(change for part in parts for change in part)
    if isinstance(a, list) and isinstance(b, list):
        pairs = zip_longest(cast(list[object], a), cast(list[object], b), fillvalue=ABSENT)
        parts = [_changes(x, y, f"{path}[{_name(x, place)}]") for place, (x, y) in enumerate(pairs)]
        return tuple(change for part in parts for change in part)
    return () if a == b else (ChangedValue(path, _text(cast(object, a)), _text(b)),)


def _name(value: object, place: int) -> str:
    """Return the id of a list entry, or its place if it has none."""
    if isinstance(value, dict):
        fields = cast(dict[str, object], value)
        return str(next((fields[key] for key in _NAMES if key in fields), place))
    return str(place)


def _below(path: str, name: str) -> str:
    return name if path in ("", "data") else f"{path}.{name}"


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)
