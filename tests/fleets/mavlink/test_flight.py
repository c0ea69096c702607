"""A drone's orders: each ends as telemetry shows, a stop withdraws them, a pilot goes first."""

import math
from datetime import timedelta

import pytest

from pa_console.fleets.mavlink.commands import Cmd
from pa_console.schema.world import World
from tests.fleets.mavlink.scripted import DENIED, IN_PROGRESS, Rig


def fly_to_gate(world: World, gate: str = "NorthGate") -> Rig:
    rig = Rig(world).ready()
    rig.order("c1", "move_to", gate)
    rig.answer(Cmd.REPOSITION)
    return rig


def test_a_move_is_done_when_telemetry_shows_it_and_not_when_it_is_accepted(world: World) -> None:
    rig = fly_to_gate(world)
    assert rig.answers("c1") == ["acknowledged"]
    rig.wait(1.0)
    assert rig.last().task == "moving"
    assert rig.last().command_id == "c1"
    place = rig.target()
    assert math.dist(place, world.frames["NorthGate"].at) <= world.frames["NorthGate"].radius_m
    rig.report(place, speed=5.0)
    assert rig.answers("c1") == ["acknowledged"], "it still moves"
    rig.report(place, 12.0)
    assert rig.answers("c1") == ["acknowledged"], "it is too low"
    rig.report(place, 20.0)
    assert rig.answers("c1") == ["acknowledged", "done"]
    assert rig.detail("c1") == "at NorthGate"
    assert rig.last().task == "holding"
    assert rig.last().command_id is None


def test_from_the_ground_it_is_armed_takes_off_and_climbs_first(world: World) -> None:
    rig = Rig(world, flies=False).ready()
    assert rig.autopilot.sent == [], "nothing is armed at connect"
    rig.order("c1", "move_to", "NorthGate")
    for command in (Cmd.ARM, Cmd.TAKEOFF):
        assert rig.autopilot.asked()[-1] == command
        rig.answer(command)
    rig.wait(6.0)
    assert rig.autopilot.asked() == [Cmd.ARM, Cmd.TAKEOFF]
    assert rig.answers("c1") == ["acknowledged", "progress"]
    assert rig.detail("c1") == "takes off: at 0 of 20 m"
    rig.flight.state.on_ground = False
    rig.report(height=19.0)
    rig.wait(0.2)
    assert rig.autopilot.asked() == [Cmd.ARM, Cmd.TAKEOFF, Cmd.REPOSITION]


@pytest.mark.parametrize(("kind", "height"), [("px4", 120.0), ("ardupilot", 20.0)])
def test_the_height_of_a_take_off_is_what_the_autopilot_means_by_it(
    world: World, kind: str, height: float
) -> None:
    rig = Rig(world, flies=False, kind="px4" if kind == "px4" else "ardupilot").ready()
    rig.order("c1", "move_to", "NorthGate")
    if kind == "ardupilot":
        rig.answer(Cmd.SET_MODE)
    rig.answer(Cmd.ARM)
    assert rig.autopilot.sent[-1].params[6] == height


def test_an_order_that_survives_a_lost_link_is_a_mission_with_a_region_of_interest(
    world: World,
) -> None:
    rig = Rig(world, altitudes_m={"observe": 35.0}).ready()
    rig.order("c1", "observe", "NorthGate")
    (mission,) = rig.autopilot.missions
    assert [item.command for item in mission] == [
        Cmd.WAYPOINT, Cmd.REGION_OF_INTEREST, Cmd.LOITER
    ]  # fmt: skip
    assert mission[0].z == 35.0
    assert rig.autopilot.sent == []
    rig.flight.uploaded("")
    rig.answer(Cmd.SET_MISSION_CURRENT)
    rig.answer(Cmd.START_MISSION)
    rig.report(rig.flight.place, 35.0)
    assert rig.answers("c1") == ["acknowledged", "done"]
    assert rig.last().task == "observing"
    rig.order("c2", "move_to", "SouthGate")
    assert rig.autopilot.asked()[-1] == Cmd.NO_REGION_OF_INTEREST
    rig.answer(Cmd.NO_REGION_OF_INTEREST, DENIED)
    assert rig.autopilot.asked()[-1] == Cmd.REPOSITION, "it flies on without that"


def test_a_way_round_a_closed_zone_is_a_mission_too(world: World) -> None:
    rig = Rig(world)
    rig.report((-45.0, 10.0))
    rig.ready()
    rig.order("c1", "move_to", "NorthGate")
    (mission,) = rig.autopilot.missions
    assert sum(item.command == Cmd.WAYPOINT for item in mission) > 1


def test_it_comes_home_by_its_own_return_and_is_done_when_it_has_landed_there(
    world: World,
) -> None:
    rig = Rig(world).ready()
    rig.order("c1", "return_to_base")
    assert rig.autopilot.asked() == [Cmd.RETURN_TO_LAUNCH]
    rig.answer(Cmd.RETURN_TO_LAUNCH)
    rig.report(world.frames["Base"].at, 20.0)
    assert rig.answers("c1") == ["acknowledged"]
    rig.flight.state.on_ground = True
    rig.flight.heartbeat(1, 4)
    rig.report(height=0.0)
    assert rig.answers("c1") == ["acknowledged", "done"]
    assert rig.last().task == "charging"


def test_one_that_lands_elsewhere_has_not_come_home(world: World) -> None:
    rig = Rig(world).ready()
    rig.order("c1", "return_to_base")
    rig.answer(Cmd.RETURN_TO_LAUNCH)
    rig.flight.state.on_ground = True
    rig.flight.heartbeat(1, 4)
    rig.report(height=0.0)
    assert rig.answers("c1") == ["acknowledged", "failed"]
    assert "m from Base" in rig.detail("c1")


def test_the_vehicles_own_words_are_the_reason_of_a_refusal(world: World) -> None:
    rig = Rig(world, flies=False).ready()
    rig.order("c1", "move_to", "NorthGate")
    rig.answer(Cmd.ARM, DENIED)
    assert rig.answers("c1") == []
    rig.flight.said({"severity": 3, "text": "Arming denied:\x1b compass", "id": 0, "chunk_seq": 0})
    rig.wait(1.0)
    assert rig.answers("c1") == ["refused"]
    assert rig.detail("c1") == "arm denied: Arming denied:  compass"


def test_a_failure_after_the_first_step_is_a_failure_and_no_refusal(world: World) -> None:
    rig = Rig(world, flies=False).ready()
    rig.order("c1", "move_to", "NorthGate")
    rig.answer(Cmd.ARM)
    rig.answer(Cmd.TAKEOFF, DENIED)
    rig.wait(1.0)
    assert rig.answers("c1") == ["acknowledged", "failed"]


def test_a_command_is_sent_again_until_it_is_answered_and_then_given_up(world: World) -> None:
    rig = Rig(world).ready()
    rig.order("c1", "move_to", "NorthGate")
    rig.wait(20.0)
    assert rig.autopilot.asked() == [Cmd.REPOSITION] * 4
    assert rig.answers("c1") == [], "whether it has arrived, nobody knows"
    rig.order("c1", "move_to", "NorthGate")
    rig.wait(1.0)
    assert len(rig.autopilot.asked()) > 4, "the station asked once more"


def test_progress_of_a_slow_one_is_waited_for(world: World) -> None:
    rig = Rig(world).ready()
    rig.order("c1", "move_to", "NorthGate")
    for _ in range(10):
        rig.answer(Cmd.REPOSITION, IN_PROGRESS)
        rig.wait(0.8)
    assert rig.autopilot.asked() == [Cmd.REPOSITION]
    rig.answer(Cmd.REPOSITION)
    assert rig.answers("c1") == ["acknowledged"]


def test_one_that_says_yes_and_does_not_move_has_failed(world: World) -> None:
    rig = fly_to_gate(world)
    rig.wait(30.0)
    assert rig.answers("c1")[-1] == "failed"
    assert "not come nearer" in rig.detail("c1")


def test_a_hold_withdraws_the_order_and_nothing_of_it_is_sent_again(world: World) -> None:
    rig = Rig(world).ready()
    rig.order("c1", "move_to", "NorthGate")
    rig.order("h1", "hold")
    assert rig.answers("c1") == ["failed"]
    assert rig.autopilot.holds == 1
    rig.flight.held("", answered=True)
    rig.wait(20.0)
    assert rig.autopilot.asked() == [Cmd.REPOSITION]
    rig.answer(Cmd.REPOSITION)
    assert rig.answers("c1") == ["failed"], "the late answer of a withdrawn order is of no account"
    assert rig.answers("h1") == ["acknowledged", "done"]


def test_a_hold_is_done_when_the_drone_stands_and_asked_for_again_in_another_mode(
    world: World,
) -> None:
    rig = fly_to_gate(world)
    rig.report(speed=6.0)
    rig.order("h1", "hold")
    rig.flight.held("", answered=True)
    rig.report(speed=6.0)
    assert rig.answers("h1") == ["acknowledged"]
    rig.now_s += 1.5
    rig.flight.mode_changed("OFFBOARD")
    rig.flight.step()
    assert rig.autopilot.holds == 2
    rig.flight.held("", answered=True)
    rig.now_s += 0.5
    rig.flight.mode_changed("HOLD")
    rig.report()
    assert rig.answers("h1")[-1] == "done"


def test_a_hold_that_is_not_answered_is_no_answer(world: World) -> None:
    rig = Rig(world).ready()
    rig.order("h1", "hold")
    rig.flight.held("timeout", answered=False)
    rig.wait(5.0)
    assert rig.answers("h1") == []
    rig.order("h1", "hold")
    assert rig.autopilot.holds == 2, "the same hold is carried out each time"


def test_an_order_waits_until_the_hold_before_it_is_answered(world: World) -> None:
    rig = Rig(world).ready()
    rig.order("h1", "hold")
    rig.order("c1", "move_to", "NorthGate")
    rig.wait(1.0)
    assert rig.autopilot.sent == []
    rig.flight.held("", answered=True)
    rig.wait(0.2)
    assert rig.autopilot.asked() == [Cmd.REPOSITION]


def test_a_mission_that_is_being_uploaded_is_not_started_after_a_hold(world: World) -> None:
    rig = Rig(world).ready()
    rig.order("c1", "observe", "NorthGate")
    rig.order("h1", "hold")
    assert rig.autopilot.cancelled == 1
    rig.flight.uploaded("")
    rig.flight.held("", answered=True)
    rig.wait(5.0)
    assert rig.autopilot.sent == []


def test_a_pilot_who_takes_over_ends_the_order_and_keeps_the_drone(world: World) -> None:
    rig = fly_to_gate(world)
    rig.flight.mode_changed("POSCTL")
    assert rig.answers("c1") == ["acknowledged", "failed"]
    assert "a pilot has taken over (POSCTL)" in rig.detail("c1")
    rig.report()
    assert rig.last().manual
    sent = len(rig.autopilot.sent)
    rig.order("c2", "move_to", "NorthGate")
    rig.order("c3", "return_to_base")
    rig.order("h1", "hold")
    for name in ("c2", "c3", "h1"):
        assert rig.answers(name) == ["refused"]
        assert "a pilot flies it (POSCTL)" in rig.detail(name)
    assert (len(rig.autopilot.sent), rig.autopilot.holds) == (sent, 0)
    rig.flight.mode_changed("HOLD")
    rig.order("c4", "move_to", "NorthGate")
    assert len(rig.autopilot.sent) == sent + 1


def test_one_that_returns_by_itself_says_so(world: World) -> None:
    rig = fly_to_gate(world)
    rig.wait(1.5)
    rig.flight.said({"severity": 2, "text": "Failsafe: battery low", "id": 0, "chunk_seq": 0})
    rig.flight.mode_changed("RETURN_TO_LAUNCH")
    rig.flight.step()
    assert rig.answers("c1")[-1] == "failed"
    assert "RETURN_TO_LAUNCH by itself: Failsafe: battery low" in rig.detail("c1")


def test_an_id_is_carried_out_once_and_its_answer_repeated(world: World) -> None:
    rig = fly_to_gate(world)
    rig.report(rig.target())
    assert rig.answers("c1") == ["acknowledged", "done"]
    rig.order("c1", "move_to", "NorthGate")
    assert rig.answers("c1") == ["acknowledged", "done", "done"]
    assert rig.autopilot.asked() == [Cmd.REPOSITION]


def test_it_may_be_armed_only_while_an_order_needs_it(world: World) -> None:
    rig = Rig(world, flies=False).ready()
    assert not rig.flight.may_arm()
    rig.order("c1", "move_to", "NorthGate")
    assert rig.flight.may_arm()
    rig.answer(Cmd.ARM)
    assert not rig.flight.may_arm()


def test_another_start_of_the_drone_ends_its_order_and_its_fence_is_read_again(
    world: World,
) -> None:
    rig = fly_to_gate(world)
    message = rig.message() | {"time_boot_ms": 2000}
    rig.flight.positioned(message, rig.arrival())
    assert rig.detail("c1") == "it has started again"
    assert rig.flight.fence.problem
    assert "has started again" in rig.notices()


def test_what_a_drone_cannot_do_is_refused(world: World) -> None:
    rig = Rig(world).ready()
    rig.order("c1", "warn", "NorthGate")
    rig.order("c2", "move_to", "Nowhere")
    assert rig.answers("c1") == rig.answers("c2") == ["refused"]
    assert "NorthGate" in rig.detail("c2")


def test_a_report_needs_no_flight(world: World) -> None:
    rig = Rig(world, flies=False).ready()
    rig.order("c1", "report")
    assert rig.answers("c1") == ["acknowledged", "done"]
    assert "battery 80 %" in rig.detail("c1")
    assert rig.autopilot.sent == []


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"lat": 0, "lon": 0}, "where it is"),
        ({"lat": 2_000_000_000}, "on the earth"),
        ({"lat": 480_000_000, "lon": 110_000_000}, "far from the world"),
    ],
)
def test_an_impossible_position_is_not_believed(
    world: World, change: dict[str, int], word: str
) -> None:
    rig = Rig(world).ready()
    before = rig.last()
    rig.flight.positioned(rig.message() | change, rig.arrival())
    assert rig.last() == before
    assert any(word in text for text in rig.notices())


def test_a_report_that_was_held_up_is_as_old_as_its_own_clock_says(world: World) -> None:
    rig = Rig(world).ready()
    fresh = rig.last().sent
    rig.now_s += 0.5
    arrived = fresh + timedelta(seconds=8.0)
    rig.flight.positioned(rig.message(), arrived)
    assert (arrived - rig.last().sent).total_seconds() == pytest.approx(7.5, abs=0.01)


def test_no_report_is_older_than_the_one_before_it(world: World) -> None:
    rig = Rig(world).ready()
    began, sent = rig.arrival(), [rig.last().sent]
    for boot_s, delay_s in ((20.5, 3.0), (20.7, 0.1), (20.9, 0.0)):
        message = rig.message() | {"time_boot_ms": int((rig.now_s + boot_s) * 1e3)}
        rig.flight.positioned(message, began + timedelta(seconds=boot_s + delay_s))
        sent.append(rig.last().sent)
    assert sent == sorted(sent)


def test_sensors_that_do_not_work_degrade_it_once_they_are_known(world: World) -> None:
    rig = Rig(world).ready()
    rig.flight.health(False)
    assert rig.flight.state.status == "ok", "not everything has been told yet"
    rig.flight.health(True)
    rig.flight.health(False)
    rig.report()
    assert rig.last().status == "degraded"


def test_a_hold_of_which_nothing_is_ever_heard_is_asked_for_anew(world: World) -> None:
    rig = Rig(world).ready()
    rig.order("h1", "hold")
    rig.order("h1", "hold")
    assert rig.autopilot.holds == 1, "it is still being asked for"
    rig.wait(4.0)
    rig.order("h1", "hold")
    assert rig.autopilot.holds == 2


def test_a_drone_that_stands_at_its_frame_keeps_its_place(world: World) -> None:
    rig = Rig(world)
    rig.report((2.0, 33.0))
    rig.ready()
    rig.order("c1", "move_to", "NorthGate")
    assert rig.target() == pytest.approx((2.0, 33.0), abs=0.02)


def test_one_that_returns_before_its_next_step_is_answered_is_not_sent_that_step_again(
    world: World,
) -> None:
    rig = Rig(world, flies=False).ready()
    rig.order("c1", "move_to", "EastGate")
    rig.answer(Cmd.ARM)
    rig.answer(Cmd.TAKEOFF)
    rig.flight.state.on_ground = False
    rig.report(height=19.0)
    rig.wait(1.5)
    rig.flight.mode_changed("RETURN_TO_LAUNCH")
    rig.flight.step()
    assert rig.answers("c1")[-1] == "failed"
    assert "RETURN_TO_LAUNCH by itself" in rig.detail("c1")
    sent = len(rig.autopilot.sent)
    rig.order("c1", "move_to", "EastGate")  # the station repeats what it heard nothing of
    rig.wait(5.0)
    assert len(rig.autopilot.sent) == sent
