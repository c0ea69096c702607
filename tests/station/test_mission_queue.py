"""The queue: threat, proximity, arrival, and over all of them the operator's hand."""

from datetime import UTC, datetime
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.schema.base import ALARM_PRIORITIES, AlarmPriority
from pa_console.schema.mission import Alarm, AlarmKind, Mission
from pa_console.station.mission_queue import MissionQueue

PREFIXES: dict[AlarmPriority, AlarmKind] = {
    "emergency": "hostile_track",
    "high": "unknown_track",
    "medium": "coverage_unknown",
    "low": "low_battery",
}


def mission(name: str, alarm: Alarm | None = None) -> Mission:
    return Mission(
        id=name,
        text="Do something.",
        source="alarm" if alarm else "operator",
        created=datetime(2026, 1, 1, tzinfo=UTC),
        alarm=alarm.id if alarm else "",
    )


def an_alarm(name: str, priority: AlarmPriority, distance_m: float | None = None) -> Alarm:
    return Alarm(
        id=name, kind=PREFIXES[priority], priority=priority, subject="Track_01", gate="WestGate",
        text="something", command="Do something.", raised_s=1.0, distance_m=distance_m,
    )  # fmt: skip


def queue(*alarms: Alarm | None) -> MissionQueue:
    """Return a queue of M1, M2, ... for these alarms; None is an operator's mission."""
    waiting = MissionQueue()
    for number, alarm in enumerate(alarms, start=1):
        waiting.add(mission(f"M{number}", alarm), alarm)
    return waiting


def order(waiting: MissionQueue) -> list[str]:
    return [entry.mission.id for entry in waiting.entries]


def test_threat_then_the_operator_then_proximity_then_arrival() -> None:
    waiting = queue(
        an_alarm("A1", "low"),
        an_alarm("A2", "high", 60.0),
        an_alarm("A3", "high", 20.0),
        an_alarm("A4", "high"),
        an_alarm("A5", "high"),
        None,
        an_alarm("A6", "emergency", 90.0),
    )
    assert order(waiting) == ["M7", "M6", "M3", "M2", "M4", "M5", "M1"]
    assert [entry.reason for entry in waiting.entries] == [
        "emergency, 90 m from WestGate: an emergency goes before everything else (WF-04)",
        "the operator's own mission: waits until M7 of higher threat is over (WF-05)",
        "high, 20 m from WestGate: after M6: the operator's own goes first",
        "high, 60 m from WestGate: M3 is nearer (WF-04)",
        "high: M2 is nearer (WF-04)",
        "high: arrived after M4",
        "low: a low battery waits until the active mission is over (WF-05)",
    ]


def test_a_nearer_track_moves_up_and_a_mission_put_back_keeps_its_place() -> None:
    far, near = an_alarm("A1", "high", 60.0), an_alarm("A2", "high", 20.0)
    waiting = queue(far, near)
    waiting.refresh([an_alarm("A1", "high", 5.0), near])
    first = waiting.pop_next()
    assert first is not None
    assert first.id == "M1"
    waiting.refresh([an_alarm("A2", "high", 5.0)])
    waiting.add(first, an_alarm("A1", "high", 5.0))
    assert order(waiting) == ["M1", "M2"]


def test_a_deferred_mission_goes_last_until_nothing_else_waits() -> None:
    waiting = queue(an_alarm("A1", "emergency"), an_alarm("A2", "low"))
    waiting.defer("M1")
    assert order(waiting) == ["M2", "M1"]
    assert waiting.preempts(mission("M9"), None) is None
    waiting.add(mission("M3", an_alarm("A3", "low")), an_alarm("A3", "low"))
    assert order(waiting) == ["M2", "M3", "M1"]
    waiting.defer("M1", deferred=False)
    assert order(waiting) == ["M1", "M2", "M3"]


def test_the_operators_order_wins_but_an_emergency_still_comes_first() -> None:
    waiting = queue(an_alarm("A1", "high", 5.0), an_alarm("A2", "low"), an_alarm("A3", "high"))
    waiting.move("M2", "up")
    waiting.move("M2", "up")
    assert order(waiting) == ["M2", "M1", "M3"]
    assert waiting.entries[0].reason == "low, moved here by the operator"
    assert "as the operator ordered" in waiting.entries[1].reason
    waiting.add(mission("M4", an_alarm("A4", "emergency")), an_alarm("A4", "emergency"))
    assert order(waiting) == ["M4", "M2", "M1", "M3"]


@pytest.mark.parametrize("priority", ALARM_PRIORITIES)
def test_only_an_emergency_preempts_and_only_what_is_none(priority: AlarmPriority) -> None:
    waiting = queue(an_alarm("A1", priority))
    for active in (None, *(an_alarm("A9", other) for other in ALARM_PRIORITIES)):
        entry = waiting.preempts(mission("M9", active), active)
        due = priority == "emergency" and (active is None or active.priority != "emergency")
        assert (entry is not None) == due


def test_what_does_not_wait_cannot_be_touched() -> None:
    waiting = queue(None)
    with pytest.raises(ValueError, match="M7 does not wait; waiting: M1"):
        waiting.move("M7", "up")
    with pytest.raises(ValueError, match="M7"):
        waiting.defer("M7")
    with pytest.raises(ValueError, match="M1 waits already"):
        waiting.add(mission("M1"))


alarms = st.one_of(
    st.none(),
    st.builds(
        an_alarm,
        name=st.sampled_from(["A1", "A2", "A3"]),
        priority=st.sampled_from(ALARM_PRIORITIES),
        distance_m=st.sampled_from([None, 5.0, 50.0]),
    ),
)
numbers = st.integers(0, 9)
operations = st.lists(
    st.one_of(
        st.tuples(st.just("add"), numbers, alarms),
        st.tuples(st.sampled_from(["pop", "remove", "defer", "undefer", "up", "down"]), numbers),
        st.tuples(st.just("refresh"), alarms),
    ),
    max_size=30,
)


def _step(waiting: MissionQueue, expected: set[str], step: tuple[object, ...]) -> None:
    """Carry one operation out on the queue and on the set of ids that must be in it."""
    match step:
        case ("add", int(number), alarm) if f"M{number}" not in expected:
            assert alarm is None or isinstance(alarm, Alarm)
            waiting.add(mission(f"M{number}", alarm), alarm)
            expected.add(f"M{number}")
        case ("pop", _):
            first = next(iter(order(waiting)), None)
            taken = waiting.pop_next()
            assert (taken.id if taken else None) == first
            expected.discard(first or "")
        case ("remove", int(number)) if f"M{number}" in expected:
            waiting.remove(f"M{number}")
            expected.discard(f"M{number}")
        case ("defer" | "undefer" as kind, int(number)) if f"M{number}" in expected:
            waiting.defer(f"M{number}", kind == "defer")
        case ("up", int(number)) if f"M{number}" in expected:
            _move(waiting, f"M{number}", "up")
        case ("down", int(number)) if f"M{number}" in expected:
            _move(waiting, f"M{number}", "down")
        case ("refresh", Alarm() as alarm):
            waiting.refresh([alarm])
        case _:
            pass


def _move(waiting: MissionQueue, name: str, to: Literal["up", "down"]) -> None:
    """Move one and see it exactly one place further, or where it was at the end."""
    was = order(waiting)
    waiting.move(name, to)
    new = was.index(name) + (-1 if to == "up" else 1)
    assert order(waiting).index(name) == max(0, min(len(was) - 1, new))


@given(operations)
def test_no_mission_is_lost_or_doubled_whatever_is_done(steps: list[tuple[object, ...]]) -> None:
    waiting, twin = MissionQueue(), MissionQueue()
    expected: set[str] = set()
    also: set[str] = set()
    for step in steps:
        _step(waiting, expected, step)
        _step(twin, also, step)
        assert sorted(order(waiting)) == sorted(expected)
        assert waiting.entries == twin.entries
    taken = [waiting.pop_next() for _ in range(len(expected))]
    assert sorted(m.id for m in taken if m is not None) == sorted(expected)
    assert waiting.pop_next() is None


@given(st.data(), st.lists(alarms, max_size=7))
def test_the_order_of_insertion_matters_only_among_equals(
    data: st.DataObject, wanted: list[Alarm | None]
) -> None:
    numbered = list(enumerate(wanted))
    forward, shuffled = MissionQueue(), MissionQueue()
    for number, alarm in numbered:
        forward.add(mission(f"M{number}", alarm), alarm)
    for number, alarm in data.draw(st.permutations(numbered)):
        shuffled.add(mission(f"M{number}", alarm), alarm)

    def keys(waiting: MissionQueue) -> list[tuple[str, bool, float | None]]:
        return [(e.priority, e.mission.source == "alarm", e.distance_m) for e in waiting.entries]

    assert keys(forward) == keys(shuffled)
