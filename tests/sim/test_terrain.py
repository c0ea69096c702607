"""What is looked up quickly is what asking everybody would give."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point

from pa_console.schema.world import World
from pa_console.sim.assets.surroundings import Traffic
from pa_console.sim.state import AssetState, Scene
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


@given(points=st.lists(spots, min_size=1, max_size=40), moving=st.integers(0, 2**40))
@settings(max_examples=100, deadline=None)
def test_everybody_within_reach_is_found(points: list[tuple[float, float]], moving: int) -> None:
    scene = Scene(rng=random.Random(0))
    for number, point in enumerate(points):
        asset = AssetState(f"A{number}", "ugv", number, *point, 0.0, 100.0, None, point)
        asset.route = ((0.0, 0.0),) if moving >> number & 1 else ()
        scene.assets[asset.id] = asset
    me = scene.assets["A0"]
    expected = [
        other.id
        for other in scene.assets.values()
        if math.dist(me.position, other.position) <= (20.0 if other.route else 10.0)
    ]
    assert [other.id for other in Traffic(scene, 10.0, 20.0).near(me)] == expected


def test_places_taken_one_after_the_other_stand_apart_until_a_frame_is_full(
    terrain: Terrain,
) -> None:
    frame = terrain.world.base
    taken: list[tuple[float, float]] = []
    while (place := terrain.free_place(frame, "ugv", taken)) is not None:
        assert all(math.dist(place, other) > terrain.spacing_m - 0.2 for other in taken)
        taken.append(place)
    assert len(taken) == len(terrain.places(frame, "ugv"))
