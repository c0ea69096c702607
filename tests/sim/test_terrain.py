"""What is looked up quickly is what asking everybody would give."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point

from pa_console.schema.world import World
from pa_console.sim.physics import Traffic
from pa_console.sim.scene import AssetState
from pa_console.sim.worlds.terrain import Terrain
from pa_console.sim.worlds.world_generator import generate_world

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
