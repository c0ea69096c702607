"""The timeline of a recording: time, kind and mark of every event, in 25 bytes per event.

The events themselves stay on the disk.
"""

import re
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Literal, get_args

from pa_console.schema.events import event as ev
from pa_console.schema.incident import Incident
from pa_console.session.log.chain import KINDS
from pa_console.session.state import SessionState
from pa_console.session.wording import deviations_in_words

MarkKind = Literal["fault", "refusal", "alarm", "finding", "mission"]
"""The kinds of marks to which a viewer can jump, worst first; of several marks at one place, the
worst is shown."""

MARK_KINDS: tuple[MarkKind, ...] = get_args(MarkKind)
_NO_FAULTS = frozenset(("spawn", "restore", "weather", "turn", "place", "clear"))
KIND_NAMES = tuple(sorted(KINDS))
_CODES = {kind: code for code, kind in enumerate(KIND_NAMES)}
_TELEMETRY = _CODES["telemetry"]
_MOST = 2**63 - 1
_NOT_TELEMETRY = re.compile(b"[^" + re.escape(bytes((_TELEMETRY,))) + b"]")


def mark_of(event: ev.Event, before: SessionState) -> MarkKind | None:
    """Return the mark of `event`, given the state `before` it; None if the event has no mark."""
    kind: MarkKind | None = None
    if _is_fault(event.data):
        kind = "fault"
    elif _is_refusal(event.data):
        kind = "refusal"
    elif _is_finding(event.data):
        kind = "finding"
    elif isinstance(event.data, ev.MissionReceived):
        kind = "mission"
    elif isinstance(event.data, ev.AlarmRaised) and before.is_news(event.data.alarm):
        kind = "alarm"
    return kind


def _is_finding(data: ev.EventPayload) -> bool:
    """Return True if a check, the judge or telemetry objects, or an operator changes a plan."""
    match data:
        case ev.PlanChecked(findings=findings):
            return any(finding.broken for finding in findings)
        case ev.PlanJudged(verdict=verdict) | ev.OutcomeJudged(verdict=verdict):
            return verdict is None or verdict.verdict == "Failure"
        case ev.MissionVerified(verification=verification):
            return verification.outcome == "fail"
        case ev.DecisionMade(accepted=True, decision=decision):
            return bool(deviations_in_words(decision))
        case _:
            return False


def _is_refusal(data: ev.EventPayload) -> bool:
    """Return True if a plan is blocked or rejected, a mission refused, or a decision invalid."""
    match data:
        case ev.ApprovalRequested(blocked_by=blocked):
            return bool(blocked)
        case ev.DecisionMade(accepted=accepted, decision=decision):
            return not accepted or decision.kind == "reject"
        case ev.MissionFinished(status=status):
            return status == "refused"
        case _:
            return False


def _is_fault(data: ev.EventPayload) -> bool:
    """Return True for a fault of a device, model or incident, and for a halt, stop or refusal."""
    match data:
        case ev.IncidentHappened(incident=incident):
            return _breaks(incident)
        case ev.WorkerChanged(state=state):
            return state in ("dead", "unavailable")
        case ev.ServerChanged(state=state):
            return state == "away"
        case ev.CommandReplied(reply=reply):
            return reply.status in ("failed", "refused")
        case _:
            return isinstance(
                data, ev.PlanHalted | ev.StepsHeld | ev.AllStopped | ev.CommandRefused
            )


def _breaks(incident: Incident) -> bool:
    """Return True if an incident makes something worse, as repairs and new tracks do not."""
    match incident.kind:
        case "comms":
            return incident.comms != "ok"
        case "radio":
            return not incident.up or incident.loss > 0
        case "sensor":
            return not incident.works
        case "gps":
            return incident.rate_mps > 0
        case "spoof":
            return incident.frame is not None
        case _:
            return incident.kind not in _NO_FAULTS


class RecordingTimeline:
    """The columns of a timeline, with an entry for each event.

    `seconds` count from the first event by the events' own time stamps, and `ticks` are those of
    the simulation; neither ever decreases. `ticks_per_s` is the number of ticks per simulated
    second, or 0 while it is unknown.
    """

    def __init__(self) -> None:
        """Begin without events."""
        self.start: datetime | None = None
        self.ticks_per_s = 0.0
        self.seconds = array("d")
        self.ticks = array("q")
        self.kinds = bytearray()
        self.marks = array("Q")
        self.mark_kinds = bytearray()

    def __len__(self) -> int:
        return len(self.kinds)

    @property
    def duration(self) -> float:
        """The time from the first event to the last, in seconds."""
        return self.seconds[-1] if self.seconds else 0.0

    def add(self, t: datetime, tick: int, kind: str, mark: MarkKind | None) -> None:
        """Append an event; if it is earlier than its predecessor, it gets the same time."""
        t = t if t.tzinfo is not None else t.replace(tzinfo=UTC)
        self.start = self.start or t
        self.seconds.append(max((t - self.start).total_seconds(), self.duration))
        self.ticks.append(min(max(tick, self.ticks[-1] if self.ticks else 0), _MOST))
        if mark is not None:
            self.marks.append(len(self.kinds))
            self.mark_kinds.append(MARK_KINDS.index(mark))
        self.kinds.append(_CODES[kind])

    def see_clock(self, tick: int, time_s: float) -> None:
        """Set the number of ticks per second, given that `tick` is at simulated time `time_s`."""
        if time_s > 0:
            self.ticks_per_s = tick / time_s

    def kind(self, index: int) -> str:
        """Return the kind of event `index`."""
        return KIND_NAMES[self.kinds[index]]

    def is_telemetry(self, index: int) -> bool:
        """Return True if event `index` is telemetry."""
        return self.kinds[index] == _TELEMETRY

    def last_telemetry(self, count: int) -> int:
        """Return the index of the last telemetry among the first `count` events, or -1."""
        return self.kinds.rfind(_TELEMETRY, 0, count)

    def without_telemetry(self, first: int, end: int) -> Iterator[int]:
        """Yield the indexes from `first` up to `end` of events that are not telemetry."""
        return (match.start() for match in _NOT_TELEMETRY.finditer(self.kinds, first, end))

    def kinds_between(self, first: int, end: int) -> frozenset[str]:
        """Return the kinds of the events with indexes from `first` up to `end`."""
        return frozenset(KIND_NAMES[code] for code in set(self.kinds[first:end]))

    def count_until(self, seconds: float) -> int:
        """Return the number of events up to `seconds` after the first event."""
        return bisect_right(self.seconds, seconds)

    def count_until_tick(self, tick: float) -> int:
        """Return the number of events up to the end of the simulation's `tick`."""
        return bisect_right(self.ticks, tick)

    def mark_after(self, index: int, kinds: frozenset[MarkKind]) -> int | None:
        """Return the index of the first mark of these `kinds` at or after `index`, or None."""
        wanted = [MARK_KINDS.index(kind) for kind in kinds]
        places = range(bisect_left(self.marks, index), len(self.marks))
        return next((self.marks[i] for i in places if self.mark_kinds[i] in wanted), None)

    def mark_before(self, index: int, kinds: frozenset[MarkKind]) -> int | None:
        """Return the index of the last mark of these `kinds` before `index`, or None."""
        wanted = [MARK_KINDS.index(kind) for kind in kinds]
        places = range(bisect_left(self.marks, index) - 1, -1, -1)
        return next((self.marks[i] for i in places if self.mark_kinds[i] in wanted), None)

    def marks_by_place(self, places: int) -> list[MarkKind | None]:
        """Return the worst mark, or None, in each of `places` equal parts of the duration."""
        highest: list[int | None] = [None] * places
        scale = places / self.duration if self.duration > 0 else 0.0
        for index, kind in zip(self.marks, self.mark_kinds, strict=True):
            place = min(int(self.seconds[index] * scale), places - 1)
            present = highest[place]
            highest[place] = kind if present is None else min(present, kind)
        return [None if kind is None else MARK_KINDS[kind] for kind in highest]
