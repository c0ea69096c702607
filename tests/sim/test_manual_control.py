"""A person drives an asset: its device takes nothing but a hold; its gate counts by position."""

import pytest

from pa_console.schema.incident import DriveByHand, SetComms
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import carry_out, finish, order, run


def alone_at(sim: Checkpoint, gate: str) -> str:
    """Return the asset that alone covers `gate`, after all others have gone home."""
    first, *others = sim.picture().gates[gate].by
    for name in others:
        carry_out(sim, name, "return_to_base")
    return first


def test_a_driven_asset_reports_it_and_is_not_available(sim: Checkpoint) -> None:
    assert not sim.picture().assets["Drone_T04"].manual
    sim.inject(DriveByHand(asset="Drone_T04"))
    run(sim, 2.0)
    shown = sim.picture().assets["Drone_T04"]
    assert (shown.manual, shown.available, shown.status) == (True, False, "ok")
    sim.inject(DriveByHand(asset="Drone_T04", ends=True))
    run(sim, 2.0)
    shown = sim.picture().assets["Drone_T04"]
    assert (shown.manual, shown.available) == (False, True)


def test_its_device_refuses_everything_but_a_hold(sim: Checkpoint) -> None:
    sim.inject(DriveByHand(asset="Drone_T04", frame="NorthGate"))
    run(sim, 2.0)
    refused = finish(sim, order(sim, "Drone_T04", "move_to", "SouthGate"))
    assert (refused[-1].status, refused[-1].detail) == ("refused", "it is under manual control")
    assert sim.picture().assets["Drone_T04"].speed_mps > 0.0
    held = finish(sim, order(sim, "Drone_T04", "hold"))
    assert held[-1].status == "done"
    run(sim, 2.0)
    assert sim.picture().assets["Drone_T04"].speed_mps == 0.0


def test_what_it_was_ordered_before_is_not_carried_on(sim: Checkpoint) -> None:
    order(sim, "Drone_T04", "move_to", "NorthGate")
    run(sim, 2.0)
    sim.inject(DriveByHand(asset="Drone_T04"))
    sim.inject(DriveByHand(asset="Drone_T04", ends=True))
    where = sim.truth().assets["Drone_T04"].position
    run(sim, 5.0)
    assert sim.truth().assets["Drone_T04"].position == where


def test_a_driven_asset_covers_its_gate_while_its_position_does(sim: Checkpoint) -> None:
    guard = alone_at(sim, "WestGate")
    sim.inject(DriveByHand(asset=guard))
    run(sim, 2.0)
    assert sim.picture().gates["WestGate"].by == (guard,)
    sim.inject(DriveByHand(asset=guard, frame="EastGate"))
    run(sim, 8.0)
    assert not sim.picture().gates["WestGate"].covered
    run(sim, 60.0)
    assert sim.picture().assets[guard].at == "EastGate"
    assert guard not in sim.picture().gates["EastGate"].by


def test_a_driven_asset_that_falls_silent_covers_nothing_for_certain(sim: Checkpoint) -> None:
    guard = alone_at(sim, "WestGate")
    sim.inject(DriveByHand(asset=guard))
    run(sim, 2.0)
    sim.inject(SetComms(asset=guard, comms="lost"))
    run(sim, sim.world.link_lost_s + 2.0)
    assert sim.picture().gates["WestGate"].unknown


def test_what_the_station_has_taken_is_shown_at_once_and_no_device_hears_of_it(
    sim: Checkpoint,
) -> None:
    guard = alone_at(sim, "WestGate")
    sim.mark_manual(frozenset((guard,)))
    shown = sim.picture().assets[guard]
    assert (shown.manual, shown.available) == (True, False)
    assert sim.picture().gates["WestGate"].by == (guard,)
    assert not sim.truth().assets[guard].manual
    run(sim, 5.0)
    assert sim.picture().assets[guard].manual
    sim.mark_manual(frozenset())
    assert sim.picture().assets[guard].available


def test_a_forecast_leaves_a_driven_asset_where_it_is(sim: Checkpoint) -> None:
    guard = alone_at(sim, "WestGate")
    sim.mark_manual(frozenset((guard,)))
    ahead = sim.forecast()
    before = ahead.picture().assets[guard].position
    replies = finish(ahead, order(ahead, guard, "move_to", "EastGate"))
    assert replies[-1].status == "refused"
    run(ahead, 30.0)
    after = ahead.picture()
    assert after.assets[guard].position == before
    assert after.assets[guard].manual
    assert after.gates["WestGate"].by == (guard,)


def test_it_is_driven_to_no_place_that_cannot_be_reached(sim: Checkpoint) -> None:
    with pytest.raises(ValueError, match="there is no frame 'Nowhere'"):
        sim.inject(DriveByHand(asset="Drone_T04", frame="Nowhere"))


def test_who_is_driven_is_part_of_the_state(sim: Checkpoint) -> None:
    twin = sim.fork()
    sim.inject(DriveByHand(asset="Drone_T04"))
    assert twin.state_hash() != sim.state_hash()
    twin.inject(DriveByHand(asset="Drone_T04"))
    assert twin.state_hash() == sim.state_hash()
    twin.mark_manual(frozenset(("Drone_T01",)))
    assert twin.state_hash() != sim.state_hash()
