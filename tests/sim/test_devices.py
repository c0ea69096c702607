"""Every command for every kind: acknowledged, carried out, answered, or refused with a reason."""

import math
from itertools import combinations

import pytest

from pa_console.schema.command import COMMANDS, DeviceCommand, Verb
from pa_console.schema.incident import (
    DegradeAsset,
    FailAsset,
    PlaceAsset,
    RestoreAsset,
    SetBattery,
    SetComms,
)
from pa_console.schema.world import Wall, World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import carry_out, finish, order, run

AGENTS = {"uav": "Drone_T04", "ugv": "Ugv_T02", "robot": "Robot_T01"}
PAIRS = [(verb, kind) for verb in COMMANDS for kind in AGENTS]


@pytest.mark.parametrize(("verb", "kind"), PAIRS)
def test_every_command_for_every_kind(sim: Checkpoint, verb: Verb, kind: str) -> None:
    spec = COMMANDS[verb]
    agent = AGENTS[kind]
    replies = carry_out(sim, agent, verb, "SouthGate" if spec.takes_frame else None)
    asset = sim.picture().assets[agent]
    if kind not in spec.kinds:
        assert [reply.status for reply in replies] == ["refused"]
        assert f"a {kind} cannot {verb}" in replies[0].detail
        assert asset.at == "Checkpoint"
        return
    assert replies[0].status == "acknowledged"
    if verb in ("identify", "warn"):
        assert (replies[-1].status, replies[-1].detail) == ("failed", "no track at SouthGate")
        assert asset.at == "SouthGate"
        return
    assert replies[-1].status == "done"
    task = {
        "move_to": "holding", "observe": "observing", "block": "blocking", "hold": "holding",
        "return_to_base": "charging", "report": asset.task,
    }[verb]  # fmt: skip
    place = "SouthGate" if spec.takes_frame else "Checkpoint"
    place = "Base" if verb == "return_to_base" else place
    assert (asset.at, asset.post, asset.task) == (place, place, task)
    assert asset.route == ()
    assert asset.command_id is None


@pytest.mark.parametrize("verb", list(COMMANDS))
def test_failed_asset_refuses_everything(sim: Checkpoint, verb: Verb) -> None:
    sim.inject(FailAsset(asset="Robot_T01"))
    target = "NorthGate" if COMMANDS[verb].takes_frame else None
    replies = finish(sim, order(sim, "Robot_T01", verb, target))
    assert [(reply.status, reply.detail) for reply in replies] == [
        ("refused", "the asset has failed")
    ]


def test_unknown_agent_and_unknown_frame_are_refused(sim: Checkpoint) -> None:
    [nobody] = finish(sim, order(sim, "Tank_T01", "hold"))
    [nowhere] = finish(sim, order(sim, "Ugv_T02", "move_to", "Moon"))
    assert (nobody.status, nowhere.status) == ("refused", "refused")
    assert "Drone_T01" in nobody.detail
    assert "NorthGate" in nowhere.detail


def test_a_new_command_supersedes_the_old_one(sim: Checkpoint) -> None:
    first = order(sim, "Ugv_T02", "move_to", "NorthGate")
    run(sim, 2.0)
    second = order(sim, "Ugv_T02", "block", "SouthGate")
    replies = finish(sim, second)
    assert replies[-1].status == "done"
    repeated = finish(sim, order(sim, "Ugv_T02", "move_to", "NorthGate", command_id=first))
    assert (repeated[-1].status, repeated[-1].detail) == ("failed", "superseded")


def test_report_leaves_the_task_under_way(sim: Checkpoint) -> None:
    moving = order(sim, "Ugv_T02", "move_to", "NorthGate")
    run(sim, 2.0)
    report = finish(sim, order(sim, "Ugv_T02", "report"))[-1]
    assert report.status == "done"
    assert "battery" in report.detail
    assert finish(sim, moving)[-1].status == "done"


def test_hold_stops_at_once_between_frames(sim: Checkpoint) -> None:
    order(sim, "Drone_T01", "move_to", "EastGate")
    run(sim, 2.0)
    carry_out(sim, "Drone_T01", "hold")
    held = sim.picture().assets["Drone_T01"]
    run(sim, 3.0)
    later = sim.picture().assets["Drone_T01"]
    assert held.position == later.position
    assert (later.at, later.post, later.speed_mps) == (None, None, 0.0)


def test_hold_at_a_gate_keeps_covering_it(sim: Checkpoint) -> None:
    carry_out(sim, "Drone_T01", "hold")
    assert sim.picture().gates["WestGate"].by == ("Drone_T01",)


def test_a_command_id_is_carried_out_once(sim: Checkpoint) -> None:
    command = DeviceCommand(command_id="once", agent="Drone_T04", verb="observe", target="EastGate")
    sim.send(command)
    assert finish(sim, "once")[-1].status == "done"
    carry_out(sim, "Drone_T04", "return_to_base")
    sim.send(command)
    assert [reply.status for reply in run(sim, 5.0)] == ["done"]
    assert sim.picture().assets["Drone_T04"].at == "Base"


def test_unreachable_frame_fails_with_a_reason(world: World) -> None:
    across = Wall(start=(-60.0, 28.0), end=(60.0, 28.0))
    sim = Checkpoint(world.model_copy(update={"walls": (*world.walls, across)}))
    reply = finish(sim, order(sim, "Ugv_T02", "move_to", "NorthGate"))[-1]
    assert (reply.status, reply.detail) == ("failed", "NorthGate cannot be reached")
    run(sim, 0.5)
    assert sim.picture().assets["Ugv_T02"].post == "Checkpoint"
    assert finish(sim, order(sim, "Drone_T04", "move_to", "NorthGate"))[-1].status == "done"


def test_failing_under_way_ends_the_command_and_restoring_helps(sim: Checkpoint) -> None:
    moving = order(sim, "Ugv_T02", "block", "EastGate")
    run(sim, 3.0)
    sim.inject(FailAsset(asset="Ugv_T02"))
    stopped = sim.truth().assets["Ugv_T02"].position
    reply = finish(sim, moving)[-1]
    assert (reply.status, reply.detail) == ("failed", "the asset has failed")
    run(sim, 2.0)
    wreck = sim.picture().assets["Ugv_T02"]
    assert (wreck.status, wreck.task, wreck.available) == ("failed", "none", False)
    assert math.dist(wreck.position, stopped) < 0.5
    sim.inject(RestoreAsset(asset="Ugv_T02"))
    assert carry_out(sim, "Ugv_T02", "block", "EastGate")[-1].status == "done"


def test_empty_battery_fails_the_asset(sim: Checkpoint) -> None:
    sim.inject(SetBattery(asset="Drone_T04", percent=0.1))
    moving = order(sim, "Drone_T04", "observe", "WestGate")
    reply = finish(sim, moving)[-1]
    run(sim, 1.0)
    assert (reply.status, reply.detail) == ("failed", "the battery is empty")
    assert sim.picture().assets["Drone_T04"].status == "failed"


def test_moving_drains_more_than_standing_and_the_base_charges(sim: Checkpoint) -> None:
    sim.inject(SetBattery(asset="Ugv_T02", percent=20.0))
    sim.inject(SetBattery(asset="Ugv_T01", percent=20.0))
    assert sim.picture().assets["Ugv_T02"].low_battery
    order(sim, "Ugv_T02", "return_to_base")
    run(sim, 8.0)
    assets = sim.picture().assets
    assert assets["Ugv_T02"].battery_pct < assets["Ugv_T01"].battery_pct < 20.0
    run(sim, 120.0)
    assert sim.picture().assets["Ugv_T02"].battery_pct > 25.0


def test_lost_link_swallows_commands_and_freezes_telemetry(sim: Checkpoint) -> None:
    sim.inject(SetComms(asset="Drone_T01", comms="lost"))
    order(sim, "Drone_T01", "move_to", "Base")
    assert run(sim, 8.0) == []
    asset = sim.picture().assets["Drone_T01"]
    assert (asset.comms, asset.available, asset.stamp_s) == ("lost", False, 0.0)
    assert not sim.picture().gates["WestGate"].covered
    sim.inject(SetComms(asset="Drone_T01", comms="ok"))
    run(sim, 1.0)
    asset = sim.picture().assets["Drone_T01"]
    assert (asset.at, asset.available) == ("WestGate", True)


def test_several_assets_at_one_frame_stand_apart(sim: Checkpoint) -> None:
    agents = ["Ugv_T01", "Ugv_T02", "Robot_T01", "Robot_T02"]
    for agent in agents:
        order(sim, agent, "move_to", "SouthGate", command_id=agent)
    done = [reply for reply in run(sim, 60.0) if reply.status == "done"]
    assert sorted(reply.agent for reply in done) == sorted(agents)
    standing = [sim.picture().assets[agent] for agent in agents]
    for a, b in combinations(standing, 2):
        hulls = sum(sim.world.platforms[asset.kind].radius_m for asset in (a, b))
        assert math.dist(a.position, b.position) > hulls
    assert set(agents) <= set(sim.picture().gates["SouthGate"].by)


def test_placing_puts_an_asset_at_a_free_place(sim: Checkpoint) -> None:
    sim.inject(PlaceAsset(asset="Ugv_T02", frame="EastGate"))
    assets = sim.picture().assets
    assert assets["Ugv_T02"].at == assets["Ugv_T02"].post == "EastGate"
    assert math.dist(assets["Ugv_T02"].position, assets["Ugv_T01"].position) > 2.0
    assert sim.picture().gates["EastGate"].by == ("Ugv_T01", "Ugv_T02")


def test_a_degraded_asset_goes_on_at_a_part_of_its_speed(sim: Checkpoint) -> None:
    sim.inject(DegradeAsset(asset="Ugv_T02", speed_factor=0.25))
    assert sim.picture().assets["Ugv_T02"].status == "degraded"
    moving = order(sim, "Ugv_T02", "block", "EastGate")
    speeds: list[float] = []
    for _ in range(20):
        run(sim, 0.5)
        speeds.append(sim.picture().assets["Ugv_T02"].speed_mps)
    assert max(speeds) == pytest.approx(1.0, abs=0.01)
    assert finish(sim, moving)[-1].status == "done"
    sim.inject(RestoreAsset(asset="Ugv_T02"))
    run(sim, 1.0)
    assert sim.picture().assets["Ugv_T02"].status == "ok"


def test_an_asset_that_is_full_stays_full_at_the_base_until_it_moves(sim: Checkpoint) -> None:
    sim.inject(SetBattery(asset="Drone_T04", percent=95.0))
    carry_out(sim, "Drone_T04", "return_to_base")
    run(sim, 1200.0)
    parked = sim.truth().assets["Drone_T04"]
    assert (parked.task, parked.battery_pct) == ("idle", 100.0)
    carry_out(sim, "Drone_T04", "move_to", "Checkpoint")
    run(sim, 60.0)
    assert sim.truth().assets["Drone_T04"].battery_pct < 98.0
