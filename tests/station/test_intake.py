"""Alarms that become missions, missions that wait, and which of them get their turn."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.resources import data_folder
from pa_console.schema.base import ALARM_PRIORITIES, AlarmPriority
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Alarm, AlarmKind, Mission
from pa_console.schema.telemetry import Picture, Track
from pa_console.sim.worlds.world_file import load_world
from pa_console.station.alarms.alarm_book import MOST_ALIKE
from pa_console.station.intake import MOST_FROM_ALARMS, Arrivals, Intake, ReadText
from pa_console.station.mission_queue import MissionQueue
from tests.mission.pictures import asset, picture, track

WORLD = load_world(data_folder() / "worlds" / "checkpoint" / "world.yaml")
POSTS = (
    asset("Drone_T01", "uav", "WestGate"), asset("Drone_T02", "uav", "NorthGate"),
    asset("Drone_T03", "uav", "SouthGate"), asset("Ugv_T01", "ugv", "EastGate"),
)  # fmt: skip


def at(seconds: float, *tracks: Track) -> Picture:
    """Return the picture at a time, everything in it fresh."""
    now = picture(
        *(a.model_copy(update={"stamp_s": seconds}) for a in POSTS),
        tracks=tuple(t.model_copy(update={"stamp_s": seconds}) for t in tracks),
    )
    return now.model_copy(update={"tick": round(seconds * 10), "time_s": seconds})


def play(
    intake: Intake, start_s: float, stop_s: float, *tracks: Track, handled: Sequence[str] = ()
) -> Arrivals:
    """Show the intake the same situation twice a second; return all that it brought."""
    found = Arrivals()
    for half in range(round(start_s * 2), round(stop_s * 2)):
        arrivals = intake.look(at(half / 2, *tracks), handled)
        found.payloads += arrivals.payloads
        found.obsolete += arrivals.obsolete
    return found


def missions(arrivals: Arrivals) -> list[Mission]:
    found = [p.mission for p, _ in arrivals.payloads if isinstance(p, ev.MissionReceived)]
    assert [m for p, m in arrivals.payloads if isinstance(p, ev.MissionReceived)] == [
        mission.id for mission in found
    ]
    return found


def intake(*, respond: bool = True) -> Intake:
    return Intake(WORLD, "20260101T000000-abcd", respond=respond)


VAN = track("Track_01", "WestGate")


def test_an_alarm_becomes_one_mission_that_knows_what_it_is_about() -> None:
    desk = intake()
    [mission] = missions(play(desk, 1.0, 10.0, VAN))
    [alarm] = desk.alarms.open
    assert (mission.source, mission.alarm, mission.text) == ("alarm", alarm.id, alarm.command)
    assert (mission.subject, mission.gate) == ("Track_01", "WestGate")
    assert mission.id.endswith("-abcd")
    assert desk.alarm_of(mission) == alarm
    assert desk.queue.pop_next() == mission
    assert desk.queue.pop_next() is None


def test_without_responding_alarms_are_told_and_nothing_is_queued() -> None:
    desk = intake(respond=False)
    arrivals = play(desk, 1.0, 10.0, VAN)
    assert [p.kind for p, _ in arrivals.payloads] == ["alarm_raised"]
    assert len(desk.queue.missions) == 0


def test_what_the_active_mission_deals_with_needs_no_other() -> None:
    desk = intake()
    arrivals = play(desk, 1.0, 10.0, VAN, handled=["Track_01"])
    assert missions(arrivals) == []
    assert [a.subject for a in desk.alarms.open] == ["Track_01"]


def test_a_mission_whose_alarm_clears_while_it_waits_is_dropped() -> None:
    desk = intake()
    [mission] = missions(play(desk, 1.0, 5.0, VAN))
    assert play(desk, 5.0, 60.0).obsolete == [mission]
    assert len(desk.queue.missions) == 0
    assert desk.alarm_of(mission) is None


def test_a_mission_that_gave_way_comes_back_only_while_its_alarm_is_open() -> None:
    desk = intake()
    [mission] = missions(play(desk, 1.0, 5.0, VAN))
    assert desk.queue.pop_next() == mission
    assert desk.put_back(mission)
    assert desk.queue.pop_next() == mission
    play(desk, 5.0, 60.0)
    assert not desk.put_back(mission)
    assert len(desk.queue.missions) == 0
    own, _ = desk.submit(ReadText("look around", "look around"), active=False)
    assert desk.queue.pop_next() == own
    assert desk.put_back(own), "an operator's mission needs no alarm"


def test_alarms_beyond_what_may_wait_get_their_mission_once_there_is_room() -> None:
    desk = intake()
    tracks = [
        track(f"Track_{n}", "WestGate", distance_m=float(n), seen_by=(f"Camera_{n % 10}",))
        for n in range(1, 41)
    ]
    first = missions(play(desk, 1.0, 5.0, *tracks))
    assert [mission.subject for mission in first] == [f"Track_{n}" for n in range(1, 33)]
    assert len(desk.alarms.open) == 40
    assert missions(play(desk, 5.0, 6.0, *tracks)) == []
    taken = desk.queue.pop_next()
    assert taken is not None
    (late,) = missions(play(desk, 6.0, 8.0, *tracks, handled=["Track_1"]))
    assert late.subject == "Track_33"
    assert len(desk.queue.missions) == MOST_FROM_ALARMS


def test_one_sensor_s_contacts_leave_room_for_missions_about_those_of_others() -> None:
    desk = intake()
    lies = [
        track(f"Track_{n}", "WestGate", identity=identity, seen_by=("Drone_T03",))
        for n, identity in enumerate(("unknown", "unauthorized") * 20)
    ]
    assert len(missions(play(desk, 1.0, 5.0, *lies))) == MOST_ALIKE
    true = track("Track_99", "WestGate", distance_m=90.0, seen_by=("NorthCamera", "Drone_T03"))
    (mission,) = missions(play(desk, 5.0, 8.0, *lies, true))
    assert mission.subject == "Track_99"
    assert desk.queue.remove(mission.id) == mission
    assert missions(play(desk, 8.0, 9.0, *lies, true)) == [], "the operator does not want it"


def test_an_emergency_goes_before_the_operators_mission_and_not_before_another() -> None:
    desk = intake()
    active, _ = desk.submit(ReadText("look around", "look around"), active=False)
    assert desk.queue.pop_next() == active
    play(desk, 1.0, 5.0, VAN)
    assert desk.emergency(active) is None
    hostile = track(
        "Track_01", "WestGate", identity="unauthorized", intent="hostile",
        hostile_by=("Drone_T01", "Robot_T01"),
    )  # fmt: skip
    threat = missions(play(desk, 5.0, 10.0, hostile))[-1]
    entry = desk.emergency(active)
    assert entry is not None
    assert (entry.mission, entry.priority) == (threat, "emergency")
    assert entry.reason
    assert desk.queue.pop_next() == threat
    assert desk.emergency(threat) is None


def test_positions_count_the_active_mission_and_ids_are_never_used_twice() -> None:
    desk = intake()
    told = [
        desk.submit(ReadText(f"mission {number}", f"mission {number}"), active=True)
        for number in range(3)
    ]
    assert [received.position for _, received in told] == [1, 2, 3]
    assert len({mission.id for mission, _ in told}) == 3
    desk.queue.take()
    again, received = desk.submit(ReadText("another", "another"), active=False)
    assert received.position == 0
    assert again.id not in {mission.id for mission, _ in told}


@pytest.mark.parametrize(("by", "order"), [(-2, "2013"), (-1, "0213"), (1, "0132"), (9, "0132")])
def test_a_mission_moves_by_as_many_places_as_there_are(by: int, order: str) -> None:
    desk = intake()
    waiting = [
        desk.submit(ReadText(f"{number}", f"{number}"), active=False)[0] for number in range(4)
    ]
    desk.move(waiting[2].id, by)
    assert "".join(mission.text for mission in desk.queue.take()) == order


def test_whatever_does_not_wait_cannot_be_moved_deferred_or_withdrawn() -> None:
    desk = intake()
    waiting, _ = desk.submit(ReadText("look around", "look around"), active=False)
    for act in (
        lambda: desk.move("M9", 1),
        lambda: desk.queue.defer("M9"),
        lambda: desk.queue.remove("M9"),
    ):
        with pytest.raises(ValueError, match=f"M9 does not wait; waiting: {waiting.id}"):
            act()
    assert desk.queue.remove(waiting.id) == waiting
    with pytest.raises(ValueError, match="waiting: none"):
        desk.queue.remove(waiting.id)


def test_the_queue_is_told_once_a_change() -> None:
    desk = intake()
    assert list(desk.changes()) == []
    first, _ = desk.submit(ReadText("first", "first"), active=False)
    second, _ = desk.submit(ReadText("second", "second"), active=False)
    [change] = desk.changes()
    assert [entry.mission for entry in change.entries] == [first, second]
    assert list(desk.changes()) == []
    desk.queue.defer(first.id)
    [change] = desk.changes()
    assert [(e.mission, e.deferred) for e in change.entries] == [(second, False), (first, True)]
    desk.queue.take()
    [change] = desk.changes()
    assert change.entries == ()


@pytest.mark.parametrize("text", ["a", "m.", "ok", "y!"])
def test_a_key_typed_too_early_is_no_order(text: str) -> None:
    desk = Intake(WORLD, "20260101T000000-abcd", respond=False)
    with pytest.raises(ValueError, match="is not an order and was not sent"):
        desk.submit(ReadText(text, text), active=False)
    assert not desk.queue.missions


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
        "high, 20 m from WestGate: after M6: the operator's own mission goes first",
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
