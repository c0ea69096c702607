"""What devices do without the station, and that the station is told when it can be (CAP-05)."""

import pytest

from pa_console.schema.incident import FailAsset, SetBattery, SetComms, SetRadio
from pa_console.schema.world import LostLink, World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import order, run


def with_lost_link(world: World, behaviour: LostLink) -> Checkpoint:
    platforms = {
        kind: platform.model_copy(update={"lost_link": behaviour, "lost_link_after_s": 5.0})
        for kind, platform in world.platforms.items()
    }
    return Checkpoint(world.model_copy(update={"platforms": platforms}), seed=4)


def test_one_that_holds_stops_and_tells_later_why(world: World) -> None:
    sim = with_lost_link(world, "hold")
    moving = order(sim, "Robot_T01", "move_to", "WestGate")
    run(sim, 3.0)
    sim.inject(SetComms(asset="Robot_T01", comms="lost"))
    run(sim, 4.5)
    assert sim.truth().assets["Robot_T01"].speed_mps > 0.0
    assert run(sim, 2.0) == []
    robot = sim.truth().assets["Robot_T01"]
    assert (robot.speed_mps, robot.task, robot.command_id) == (0.0, "holding", None)
    sim.inject(SetComms(asset="Robot_T01", comms="ok"))
    [reply] = run(sim, 1.5)
    assert (reply.command_id, reply.status, reply.detail) == (moving, "failed", "link lost")
    run(sim, 5.0)
    assert sim.truth().assets["Robot_T01"].position == robot.position


def test_one_that_returns_goes_to_base_and_charges(world: World) -> None:
    sim = with_lost_link(world, "return_to_base")
    sim.inject(SetBattery(asset="Drone_T01", percent=50.0))
    order(sim, "Drone_T01", "move_to", "EastGate")
    run(sim, 2.0)
    sim.inject(SetComms(asset="Drone_T01", comms="lost"))
    run(sim, 30.0)
    true, known = sim.truth(), sim.picture()
    assert (true.assets["Drone_T01"].at, true.assets["Drone_T01"].task) == ("Base", "charging")
    assert known.assets["Drone_T01"].at != "Base", "nobody has told the station"
    assert known.assets["Drone_T01"].comms == "lost"


@pytest.mark.parametrize(("behaviour", "at"), [("hold", "WestGate"), ("return_to_base", "Base")])
def test_one_on_its_watch_holds_it_or_leaves_it(world: World, behaviour: LostLink, at: str) -> None:
    sim = with_lost_link(world, behaviour)
    run(sim, 1.0)
    sim.inject(SetComms(asset="Drone_T01", comms="lost"))
    run(sim, 4.0)
    assert sim.truth().assets["Drone_T01"].at == "WestGate"
    run(sim, 30.0)
    assert sim.truth().assets["Drone_T01"].at == at


def test_a_short_outage_changes_nothing(world: World) -> None:
    sim = with_lost_link(world, "return_to_base")
    order(sim, "Ugv_T02", "block", "EastGate")
    run(sim, 2.0)
    sim.inject(SetComms(asset="Ugv_T02", comms="lost"))
    run(sim, 4.0)
    sim.inject(SetComms(asset="Ugv_T02", comms="ok"))
    assert [reply.status for reply in run(sim, 40.0)][-1] == "done"


def test_a_new_command_ends_the_return(world: World) -> None:
    sim = with_lost_link(world, "return_to_base")
    run(sim, 1.0)
    sim.inject(SetComms(asset="Ugv_T01", comms="lost"))
    run(sim, 8.0)
    assert sim.truth().assets["Ugv_T01"].task == "returning"
    sim.inject(SetComms(asset="Ugv_T01", comms="ok"))
    order(sim, "Ugv_T01", "block", "EastGate")
    assert run(sim, 40.0)[-1].status == "done"
    assert sim.picture().assets["Ugv_T01"].at == "EastGate"


def test_losses_alone_do_not_cut_a_device_off(world: World) -> None:
    sim = with_lost_link(world, "return_to_base")
    sim.inject(SetRadio(loss=0.3))
    run(sim, 60.0)
    assert {a.at for a in sim.truth().assets.values()} == {a.post for a in world.assets.values()}


@pytest.mark.parametrize("behaviour", ["hold", "return_to_base"])
def test_a_wreck_does_nothing(world: World, behaviour: LostLink) -> None:
    sim = with_lost_link(world, behaviour)
    run(sim, 1.0)
    sim.inject(FailAsset(asset="Drone_T01"))
    sim.inject(SetComms(asset="Drone_T01", comms="lost"))
    run(sim, 20.0)
    wreck = sim.truth().assets["Drone_T01"]
    assert (wreck.at, wreck.status, wreck.task) == ("WestGate", "failed", "none")
