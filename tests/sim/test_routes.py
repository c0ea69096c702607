"""Routes go round walls and restricted zones, and only leave the perimeter when they must."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon

from pa_console.schema.world import AssetKind, Frame, Wall, World, Zone
from pa_console.sim.worlds.routes import RoutePlanner

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
