"""What lies across the way stops ground assets, which go round it once they have seen it."""

import pytest

from pa_console.schema.incident import ObstructWay
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import carry_out, finish, order, run

BESIDE = ObstructWay(start=(30.0, -10.0), end=(30.0, 25.0))
ACROSS = ObstructWay(start=(-60.0, 28.0), end=(60.0, 28.0))


def test_an_asset_finds_a_way_round_what_it_has_run_into(sim: Checkpoint) -> None:
    direct = sim.fork()
    quick = finish(direct, order(direct, "Ugv_T02", "block", "EastGate"))[-1]
    sim.inject(BESIDE)
    first = finish(sim, order(sim, "Ugv_T02", "block", "EastGate"))[-1]
    assert first.status == "done"
    assert first.tick > quick.tick + 50
    carry_out(sim, "Ugv_T02", "move_to", "Checkpoint")
    began = sim.tick
    again = finish(sim, order(sim, "Ugv_T02", "block", "EastGate"))[-1]
    assert again.status == "done"
    assert again.tick - began < first.tick - 20


def test_nobody_knows_of_an_obstruction_beforehand(sim: Checkpoint) -> None:
    calm = sim.fork()
    sim.inject(BESIDE)
    for each in (sim, calm):
        order(each, "Ugv_T02", "block", "EastGate", command_id="go")
        run(each, 2.0)
    assert sim.picture().assets["Ugv_T02"].route == calm.picture().assets["Ugv_T02"].route
    assert sim.picture() == calm.picture()


def test_a_way_that_is_wholly_closed_ends_the_command_with_a_reason(sim: Checkpoint) -> None:
    sim.inject(ACROSS)
    reply = finish(sim, order(sim, "Ugv_T02", "move_to", "NorthGate"))[-1]
    assert (reply.status, reply.detail) == (
        "failed",
        "the way to NorthGate is closed: something lies across it",
    )
    assert sim.truth().assets["Ugv_T02"].position[1] < 27.0
    again = finish(sim, order(sim, "Ugv_T02", "move_to", "NorthGate"))[-1]
    assert (again.status, again.detail) == ("failed", "NorthGate cannot be reached")
    assert carry_out(sim, "Ugv_T02", "move_to", "SouthGate")[-1].status == "done"


def test_uavs_fly_over_it(sim: Checkpoint) -> None:
    sim.inject(ACROSS)
    assert carry_out(sim, "Drone_T04", "observe", "NorthGate")[-1].status == "done"


@pytest.mark.parametrize("fork_s", [3.0, 9.0, 14.0])
def test_forks_and_twins_meet_it_alike(sim: Checkpoint, fork_s: float) -> None:
    twin = Checkpoint(sim.world, seed=1)
    for each in (sim, twin):
        each.inject(BESIDE)
        order(each, "Ugv_T02", "block", "EastGate", command_id="one")
        order(each, "Robot_T01", "move_to", "EastGate", command_id="two")
        run(each, fork_s)
    fork = sim.fork()
    for each in (sim, twin, fork):
        run(each, 40.0)
    assert sim.state_hash() == twin.state_hash() == fork.state_hash()


def test_it_may_not_fall_on_an_asset_nor_have_no_length(sim: Checkpoint) -> None:
    at = sim.truth().assets["Robot_T01"].position
    before = sim.state_hash()
    with pytest.raises(ValueError, match="Robot_T01 stands where the obstruction would lie"):
        sim.inject(ObstructWay(start=at, end=(at[0], at[1] + 1.0)))
    with pytest.raises(ValueError, match="same point"):
        sim.inject(ObstructWay(start=(1.0, 1.0), end=(1.0, 1.0)))
    assert sim.state_hash() == before
