"""Alarms that become missions, missions that wait, and which of them get their turn."""

from collections.abc import Sequence

import pytest

from pa_console.resources import data_folder
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.schema.telemetry import Picture, Track
from pa_console.sim.worlds.world_file import load_world
from pa_console.station.alarms import MOST_ALIKE
from pa_console.station.intake import MOST_FROM_ALARMS, Arrivals, Intake, ReadText
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
    with pytest.raises(ValueError, match="is no order, and was not sent"):
        desk.submit(ReadText(text, text), active=False)
    assert not desk.queue.missions
