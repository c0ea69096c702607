"""Vehicles turn and move as their platform can, never through a wall or each other."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon

from pa_console.schema.command import DeviceCommand
from pa_console.schema.incident import FailAsset, ObstructWay, PlaceAsset
from pa_console.schema.world import AssetKind, AssetSpec, Frame, Wall, World, Zone
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.physics import Traffic
from pa_console.sim.scene import AssetState
from pa_console.sim.worlds.routes import RoutePlanner
from pa_console.sim.worlds.terrain import Terrain
from pa_console.sim.worlds.world_generator import generate_world
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


KINDS: list[AssetKind] = ["uav", "ugv", "robot"]


def test_uav_flies_straight_over_walls(world: World) -> None:
    target = world.frames["EastGate"].at
    assert RoutePlanner(world).route("uav", (0.0, 0.0), target) == (target,)


def test_ground_route_bends_round_the_barrier(world: World) -> None:
    route = RoutePlanner(world).route("ugv", (0.0, 0.0), world.frames["EastGate"].at)
    assert route is not None
    assert len(route) > 1


@given(
    kind=st.sampled_from(KINDS),
    start=st.tuples(st.floats(-52, 52), st.floats(-32, 32)),
    frame=st.sampled_from(["NorthGate", "EastGate", "SouthGate", "WestGate", "Checkpoint", "Base"]),
)
@settings(max_examples=80, deadline=None)
def test_routes_stay_clear_of_walls_zones_and_the_outside(
    world: World, kind: AssetKind, start: tuple[float, float], frame: str
) -> None:
    planner = RoutePlanner(world)
    target = world.frames[frame].at
    if not planner.area(kind, start, target).contains(*start):
        return
    route = planner.route(kind, start, target)
    assert route is not None
    line = LineString([start, *route])
    zone = Polygon(world.zones["Depot"].polygon)
    radius = world.platforms[kind].radius_m
    if not zone.covers(Point(start)):
        assert line.distance(zone) >= radius
    if kind != "uav":
        for wall in world.walls:
            gap = line.distance(LineString((wall.start, wall.end))) - wall.thickness_m / 2
            assert gap >= radius
    assert Polygon(world.perimeter).covers(line)
    assert line.length >= math.dist(start, target) - 1e-6


def test_zone_is_entered_only_for_a_target_inside_it(world: World) -> None:
    depot = world.frames | {"Depot": Frame(kind="post", at=(-45.0, 26.0))}
    inside = world.model_copy(update={"frames": depot})
    route = RoutePlanner(inside).route("ugv", (0.0, 0.0), (-45.0, 26.0))
    assert route is not None
    assert route[-1] == (-45.0, 26.0)


def test_walled_in_target_has_no_route(world: World) -> None:
    corners = [(20.0, 20.0), (40.0, 20.0), (40.0, 36.0), (20.0, 36.0)]
    box = tuple(Wall(start=a, end=b) for a, b in pairwise([*corners, corners[0]]))
    closed = world.model_copy(update={"walls": world.walls + box})
    assert RoutePlanner(closed).route("robot", (0.0, 0.0), (30.0, 28.0)) is None
    assert RoutePlanner(closed).route("uav", (0.0, 0.0), (30.0, 28.0)) == ((30.0, 28.0),)


def test_start_against_a_wall_is_led_away_first(world: World) -> None:
    start = (16.9, 0.0)
    route = RoutePlanner(world).route("ugv", start, (0.0, 0.0))
    assert route is not None
    assert len(route) == 2
    assert route[0][0] < start[0]


def test_uav_goes_round_a_zone_between_two_frames(world: World) -> None:
    zone = Zone(kind="restricted", polygon=((20.0, -5.0), (30.0, -5.0), (30.0, 5.0), (20.0, 5.0)))
    barred = world.model_copy(update={"zones": {"Middle": zone}})
    route = RoutePlanner(barred).route("uav", (0.0, 0.0), world.frames["EastGate"].at)
    assert route is not None
    line = LineString([(0.0, 0.0), *route])
    assert not line.intersects(Polygon(zone.polygon))


@pytest.mark.parametrize("kind", KINDS)
def test_a_target_outside_the_perimeter_can_be_reached(world: World, kind: AssetKind) -> None:
    route = RoutePlanner(world).route(kind, (0.0, 20.0), (0.0, 60.0))
    assert route is not None
    assert route[-1] == (0.0, 60.0)


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


spots = st.tuples(st.floats(-80, 80), st.floats(-80, 80))


@pytest.fixture(scope="module")
def terrain() -> Terrain:
    return Terrain(generate_world(9, 20, 5))


@given(spot=spots)
@settings(max_examples=200, deadline=None)
def test_the_frame_at_a_point_is_the_nearest_that_reaches_it(
    terrain: Terrain, spot: tuple[float, float]
) -> None:
    gaps = {name: math.dist(frame.at, spot) for name, frame in terrain.world.frames.items()}
    reached = [name for name, f in terrain.world.frames.items() if gaps[name] <= f.radius_m]
    assert terrain.frame_at(*spot) == min(reached, key=gaps.__getitem__, default=None)


def test_every_frame_is_where_it_is(world: World) -> None:
    terrain = Terrain(world)
    for name, frame in world.frames.items():
        assert terrain.frame_at(*frame.at) == name
        x, y = frame.at
        assert terrain.frame_at(x + frame.radius_m, y) == name


@given(spot=spots)
@settings(max_examples=100, deadline=None)
def test_no_wall_within_reach_is_left_out(terrain: Terrain, spot: tuple[float, float]) -> None:
    near = terrain.near_walls(*spot)
    for wall in terrain.world.walls:
        gap = LineString((wall.start, wall.end)).distance(Point(spot)) - wall.thickness_m / 2
        assert gap > terrain.contact_m or wall in near


@given(
    points=st.lists(spots, min_size=1, max_size=40),
    legs=st.lists(st.lists(spots, min_size=1, max_size=40), max_size=4),
)
@settings(max_examples=100, deadline=None)
def test_everybody_within_reach_is_found_after_every_move(
    points: list[tuple[float, float]], legs: list[list[tuple[float, float]]]
) -> None:
    team = [
        AssetState(f"A{number}", "ugv", number, *point, 0.0, 100.0, None, point)
        for number, point in enumerate(points)
    ]
    ground = Traffic(team, standing_m=10.0, moving_m=20.0, close_m=5.0)
    for leg in [[], *legs]:
        moving = {asset.id for asset in team[: len(leg)]}
        ground.go(moving)
        for asset, (dx, dy) in zip(team, leg, strict=False):
            asset.x, asset.y = asset.x + dx / 80, asset.y + dy / 80
        ground.went(math.sqrt(2.0))
        for me in team:
            gaps = {o.id: math.dist(me.position, o.position) for o in team if o is not me}
            found = ground.around(me)
            reach = {name: 20.0 if name in moving else 10.0 for name in gaps}
            near = {name for name, gap in gaps.items() if gap <= reach[name]}
            assert near <= {o.id for o in found.near}
            assert {name for name, gap in gaps.items() if gap <= 5.0} <= {o.id for o in found.close}
            assert me not in found.near


def test_places_taken_one_after_the_other_stand_apart_until_a_frame_is_full(
    terrain: Terrain,
) -> None:
    frame = terrain.world.base
    taken: list[tuple[float, float]] = []
    while (place := terrain.free_place(frame, "ugv", taken)) is not None:
        assert all(math.dist(place, other) > terrain.spacing_m - 0.2 for other in taken)
        taken.append(place)
    assert len(taken) == len(terrain.places(frame, "ugv"))
