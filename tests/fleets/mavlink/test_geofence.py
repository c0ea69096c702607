"""A drone flies with the world's geofence or not at all, and what is wrong with it is named."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets.mavlink.commands import Cmd, MavItem
from pa_console.fleets.mavlink.geofence import SAME_E7, difference, fence_of
from pa_console.schema.world import World
from tests.fleets.mavlink.scripted import GEOGRAPHY, Rig


def items_of(world: World) -> list[MavItem]:
    return [item for area in fence_of(world, GEOGRAPHY) for item in area.items]


def test_the_perimeter_is_an_area_to_stay_in_and_a_zone_one_to_stay_out_of(world: World) -> None:
    items = items_of(world)
    assert [item.command for item in items] == [Cmd.FENCE_INSIDE] * 4 + [Cmd.FENCE_OUTSIDE] * 4
    at = GEOGRAPHY.metres(items[0].x / 1e7, items[0].y / 1e7)
    assert at == pytest.approx(world.perimeter[0], abs=0.05)


def test_what_autopilots_round_is_the_same_fence(world: World) -> None:
    rounded = [replace(i, x=i.x + SAME_E7, y=i.y - SAME_E7, frame=0) for i in items_of(world)]
    assert difference(fence_of(world, GEOGRAPHY), rounded, GEOGRAPHY) == ""


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_every_change_is_a_difference(world: World, data: st.DataObject) -> None:
    items = items_of(world)
    number = data.draw(st.integers(0, len(items) - 1))
    units = data.draw(st.integers(3, 10_000_000)) * data.draw(st.sampled_from((-1, 1)))
    match data.draw(st.sampled_from(("move", "drop", "add", "turn", "kind"))):
        case "move":
            items[number] = replace(items[number], x=items[number].x + units)
        case "drop":
            del items[number]
        case "add":
            items.insert(number, items[number])
        case "turn":
            corner = items[number]
            other = Cmd.FENCE_INSIDE if corner.command == Cmd.FENCE_OUTSIDE else Cmd.FENCE_OUTSIDE
            items[number] = replace(corner, command=other)
        case _:
            items[number] = replace(items[number], command=5003)
    assert difference(fence_of(world, GEOGRAPHY), items, GEOGRAPHY)


def test_a_changed_corner_is_named_with_both_places(world: World) -> None:
    items = items_of(world)
    items[6] = replace(items[6], x=items[6].x + 500)
    text = difference(fence_of(world, GEOGRAPHY), items, GEOGRAPHY)
    assert text.startswith("corner 3 of zone Depot is at (")
    assert text.endswith("not at (-31.0, 14.0)")


def test_a_drone_without_a_fence_is_given_the_worlds_which_is_read_back(world: World) -> None:
    rig = Rig(world)
    rig.report()
    rig.flight.step()
    assert rig.autopilot.fence_reads == 1
    rig.read_fence(())
    assert list(rig.autopilot.fence) == items_of(world)
    assert rig.flight.fence.problem
    rig.flight.fence_uploaded("")
    assert rig.autopilot.fence_reads == 2
    rig.read_fence()
    assert rig.flight.fence.problem == ""
    assert "the perimeter of 4 corners, 1 closed zone" in rig.notices()[-1]


def test_without_an_equal_fence_nothing_starts_and_the_reason_is_given(world: World) -> None:
    rig = Rig(world, flies=False)
    rig.report()
    rig.order("c1", "move_to", "NorthGate")
    rig.order("c2", "observe", "NorthGate")
    rig.order("c3", "return_to_base")
    for name in ("c1", "c2"):
        assert rig.answers(name) == ["refused"]
        assert "its geofence has not been read yet" in rig.detail(name)
    rig.wait(5.0)
    assert rig.autopilot.sent == []


def test_a_corner_changed_by_somebody_else_is_noticed_named_and_stops_the_flight(
    world: World,
) -> None:
    rig = Rig(world).ready()
    rig.order("c1", "move_to", "NorthGate")
    rig.answer(Cmd.REPOSITION)
    reads, items = rig.autopilot.fence_reads, items_of(world)
    rig.wait(11.0)
    assert rig.autopilot.fence_reads > reads, "it is read again from time to time"
    items[0] = replace(items[0], y=items[0].y + 300)
    rig.read_fence(items)
    rig.flight.step()
    assert "corner 1 of the perimeter" in rig.notices()[-1]
    assert rig.answers("c1")[-1] == "failed"
    assert rig.autopilot.holds == 1
    rig.flight.held("", answered=True)
    rig.order("c2", "move_to", "SouthGate")
    assert rig.answers("c2") == ["refused"]
    assert "corner 1 of the perimeter" in rig.detail("c2")
    assert rig.autopilot.fence_uploads == 0, "nobody is overwritten"
    rig.order("c3", "return_to_base")
    assert rig.autopilot.asked()[-1] == Cmd.RETURN_TO_LAUNCH, "what flies may come down"
    rig.wait(11.0)
    rig.read_fence()
    rig.order("c4", "move_to", "SouthGate")
    assert rig.autopilot.asked()[-1] == Cmd.REPOSITION, "it is right again"


def test_a_fence_that_cannot_be_read_refuses_new_flights_and_lets_this_one_end(
    world: World,
) -> None:
    rig = Rig(world).ready()
    rig.order("c1", "move_to", "NorthGate")
    rig.answer(Cmd.REPOSITION)
    rig.wait(11.0)
    rig.flight.fence_read("timeout", ())
    rig.wait(0.4)
    assert rig.answers("c1")[-1] != "failed"
    rig.order("c2", "move_to", "SouthGate")
    assert "cannot be read (timeout)" in rig.detail("c2")


def test_one_that_would_not_act_on_its_fence_does_not_fly(world: World) -> None:
    rig = Rig(world, flies=False)
    rig.report()
    rig.flight.step()
    rig.flight.fence_read("", items_of(world))
    rig.flight.fence.enforced("its GF_ACTION is 0; set it to 2 (hold)")
    rig.order("c1", "move_to", "NorthGate")
    assert "GF_ACTION is 0" in rig.detail("c1")


@pytest.mark.parametrize(("mode", "at"), [("POSCTL", (0.0, 0.0)), ("HOLD", (300.0, 0.0))])
def test_the_fence_of_one_that_a_pilot_flies_or_that_is_outside_is_left_alone(
    world: World, mode: str, at: tuple[float, float]
) -> None:
    rig = Rig(world)
    rig.flight.mode_changed(mode)
    rig.report(at)
    rig.flight.step()
    rig.read_fence(())
    assert rig.autopilot.fence_uploads == 0
    assert rig.flight.fence.problem


def test_an_answer_that_nobody_asked_for_makes_no_wrong_fence_right(world: World) -> None:
    rig = Rig(world).ready()
    rig.wait(11.0)
    rig.read_fence(())
    assert rig.flight.fence.problem
    rig.flight.fence.enforced("")
    rig.flight.fence_uploaded("")
    rig.flight.fence_read("", items_of(world))
    rig.flight.fence.enforced("")
    assert rig.flight.fence.problem
    rig.order("c1", "move_to", "NorthGate")
    assert rig.answers("c1") == ["refused"]


def test_no_further_step_is_sent_from_the_moment_the_fence_is_another(world: World) -> None:
    rig = Rig(world, flies=False).ready()
    rig.order("c1", "move_to", "NorthGate")
    rig.now_s += 11.0
    rig.flight.step()
    sent = len(rig.autopilot.sent)
    rig.read_fence(items_of(world)[:-1])
    rig.answer(Cmd.ARM)
    assert len(rig.autopilot.sent) == sent
    rig.flight.step()
    assert rig.answers("c1")[-1] == "failed"


def test_the_way_home_from_the_ground_is_a_start_too(world: World) -> None:
    rig = Rig(world, flies=False).ready()
    rig.order("c1", "return_to_base")
    assert rig.autopilot.asked() == [Cmd.ARM]
    rig.now_s += 11.0
    rig.flight.step()
    sent = len(rig.autopilot.sent)
    rig.read_fence(items_of(world)[:-1])
    rig.answer(Cmd.ARM)
    rig.wait(2.0)
    assert len(rig.autopilot.sent) == sent
    assert rig.answers("c1")[-1] == "failed"
