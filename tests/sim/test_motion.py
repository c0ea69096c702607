"""Vehicles turn and move as their platform can, never through a wall or each other."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon

from pa_console.schema.command import DeviceCommand
from pa_console.schema.incident import FailAsset, PlaceAsset
from pa_console.schema.world import AssetKind, AssetSpec, World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import carry_out, finish, order, run

FRAMES = ["NorthGate", "EastGate", "SouthGate", "WestGate", "Checkpoint", "Base"]
TELEMETRY_EVERY_STEP = {"telemetry_period_s": 0.1}


def team(world: World, kinds: list[AssetKind]) -> World:
    """Return `world` with a telemetry report a step and one asset per kind, spread over frames."""
    assets = {
        f"A{index}": AssetSpec(kind=kind, post=FRAMES[index % len(FRAMES)])
        for index, kind in enumerate(kinds)
    }
    return world.model_copy(update={"assets": assets, **TELEMETRY_EVERY_STEP})


@given(
    kinds=st.lists(st.sampled_from(["ugv", "robot", "uav"]), min_size=2, max_size=10),
    orders=st.lists(
        st.tuples(st.integers(0, 9), st.sampled_from(FRAMES), st.integers(1, 150)),
        min_size=3,
        max_size=12,
    ),
)
@settings(max_examples=25, deadline=None)
def test_ground_vehicles_keep_out_of_walls_zones_and_each_other(
    world: World, kinds: list[AssetKind], orders: list[tuple[int, str, int]]
) -> None:
    sim = Checkpoint(team(world, kinds))
    radius = {kind: platform.radius_m for kind, platform in world.platforms.items()}
    walls = [(LineString((wall.start, wall.end)), wall.thickness_m / 2) for wall in world.walls]
    zone, perimeter = Polygon(world.zones["Depot"].polygon), Polygon(world.perimeter)
    for number, (agent, frame, steps) in enumerate(orders):
        order(sim, f"A{agent % len(kinds)}", "move_to", frame, command_id=str(number))
        for _ in range(steps):
            before = sim.picture().assets
            sim.step()
            now = sim.picture().assets
            ground = [asset for asset in now.values() if asset.kind != "uav"]
            for asset in now.values():
                path = LineString((before[asset.id].position, asset.position))
                assert path.length <= world.platforms[asset.kind].speed_mps * 0.1 + 0.15
                assert perimeter.covers(Point(asset.position))
                assert not zone.intersects(path)
            for asset in ground:
                path = LineString((before[asset.id].position, asset.position))
                assert all(line.distance(path) > half for line, half in walls)
            for index, a in enumerate(ground):
                for b in ground[index + 1 :]:
                    least = radius[a.kind] + radius[b.kind] - 0.2
                    assert math.dist(a.position, b.position) > least


def test_turning_takes_time(world: World) -> None:
    sim = Checkpoint(world.model_copy(update=TELEMETRY_EVERY_STEP))
    order(sim, "Ugv_T02", "move_to", "WestGate")
    heading = sim.picture().assets["Ugv_T02"].heading_deg
    for _ in range(100):
        sim.step()
        now = sim.picture().assets["Ugv_T02"].heading_deg
        turned = abs((now - heading + 180) % 360 - 180)
        assert turned <= world.platforms["ugv"].turn_rate_dps * world.dt_s + 0.2
        heading = now


def test_replacing_a_drone_takes_less_than_the_grace(sim: Checkpoint) -> None:
    for gate in sim.world.gates:
        fork = sim.fork()
        order(fork, "Ugv_T02", "move_to", gate, command_id="relief")
        finish(fork, "relief", limit_s=sim.world.coverage_grace_s)


def test_two_vehicles_in_a_narrow_passage_get_past_each_other(crossing: World) -> None:
    sim = Checkpoint(crossing)
    order(sim, "Right", "move_to", "East", command_id="right")
    order(sim, "Left", "move_to", "West", command_id="left")
    ends = {r.command_id: r.status for r in run(sim, 150.0) if r.status in ("done", "failed")}
    assert ends == {"right": "done", "left": "done"}


@pytest.mark.parametrize("mixed", [False, True])
def test_three_against_three_get_through_a_narrow_passage(crossing: World, *, mixed: bool) -> None:
    posts = ["West", "East"] * 3 if mixed else ["West"] * 3 + ["East"] * 3
    assets = {f"A{index}": AssetSpec(kind="ugv", post=post) for index, post in enumerate(posts)}
    sim = Checkpoint(crossing.model_copy(update={"assets": assets}))
    for agent, spec in assets.items():
        target = "East" if spec.post == "West" else "West"
        order(sim, agent, "move_to", target, command_id=agent)
    ends = {r.command_id: r.status for r in run(sim, 150.0) if r.status in ("done", "failed")}
    assert ends == dict.fromkeys(assets, "done")


def test_a_closed_passage_ends_the_command_with_a_reason(crossing: World) -> None:
    sim = Checkpoint(crossing)
    order(sim, "Right", "move_to", "East")
    while sim.picture().assets["Right"].position[0] < -1.0:
        sim.step()
    sim.inject(FailAsset(asset="Right"))
    reply = finish(sim, order(sim, "Left", "move_to", "West"), limit_s=150.0)[-1]
    assert reply.status == "failed"
    assert "the way to West is closed" in reply.detail


def test_a_wreck_in_the_open_is_passed(sim: Checkpoint) -> None:
    sim.inject(PlaceAsset(asset="Robot_T01", frame="Base"))
    order(sim, "Robot_T02", "move_to", "SouthGate")
    run(sim, 8.0)
    sim.inject(FailAsset(asset="Robot_T02"))
    assert carry_out(sim, "Robot_T01", "move_to", "SouthGate")[-1].status == "done"


def test_a_hundred_assets_work(world: World) -> None:
    kinds: list[AssetKind] = ["uav", "ugv", "robot", "uav"]
    large = team(world, [kinds[index % 4] for index in range(100)])
    roomy = {name: f.model_copy(update={"radius_m": 12.0}) for name, f in large.frames.items()}
    sim = Checkpoint(large.model_copy(update={"frames": roomy, "telemetry_period_s": 0.5}))
    assert all(cover.covered for cover in sim.picture().gates.values())
    waiting = {str(index) for index in range(0, 100, 8)}
    for index in sorted(waiting):
        command = DeviceCommand(command_id=index, agent=f"A{index}", verb="return_to_base")
        sim.send(command)
    while waiting and sim.time_s < 200.0:
        waiting -= {r.command_id for r in sim.step() if r.status in ("done", "failed")}
    assert not waiting
    assert len(sim.picture().assets) == 100
