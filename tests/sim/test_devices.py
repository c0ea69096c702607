"""Every command for every kind: acknowledged, carried out, answered, or refused with a reason."""

import math
from itertools import combinations

import pytest

from pa_console.schema.command import COMMANDS, DeviceCommand, Verb
from pa_console.schema.incident import (
    DegradeAsset,
    DriveByHand,
    FailAsset,
    PlaceAsset,
    RestoreAsset,
    SetBattery,
    SetComms,
    SetRadio,
)
from pa_console.schema.world import LostLink, Wall, World
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
