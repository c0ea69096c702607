"""What is looked up by cell is what asking everybody would give."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point

from pa_console.schema.world import World
from pa_console.sim.neighbours import Neighbours
from pa_console.sim.state import AssetState
from pa_console.sim.terrain import Terrain
from pa_console.sim.world_generator import generate_world

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


@given(points=st.lists(spots, max_size=40), spot=spots, cell_m=st.floats(1.0, 30.0))
@settings(max_examples=100, deadline=None)
def test_nobody_within_a_cell_is_left_out(
    points: list[tuple[float, float]], spot: tuple[float, float], cell_m: float
) -> None:
    assets = [
        AssetState(f"A{n}", "ugv", n, *point, 0.0, 100.0, None, point)
        for n, point in enumerate(points)
    ]
    near = Neighbours(assets, cell_m).near(*spot)
    assert len({asset.id for asset in near}) == len(near)
    assert {a.id for a in assets if math.dist(a.position, spot) <= cell_m} <= {a.id for a in near}


def test_places_taken_one_after_the_other_stand_apart_until_a_frame_is_full(
    terrain: Terrain,
) -> None:
    frame = terrain.world.base
    taken: list[tuple[float, float]] = []
    while (place := terrain.free_place(frame, "ugv", taken)) is not None:
        assert all(math.dist(place, other) > terrain.spacing_m - 0.2 for other in taken)
        taken.append(place)
    assert len(taken) == len(terrain.places(frame, "ugv"))
