"""World files: loading, and checks of their geometry; errors name file, line and field."""

import math
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import LineString, Polygon

from pa_console.resources import existing_data
from pa_console.schema.base import Point
from pa_console.schema.document import Document, FieldPath
from pa_console.schema.world import World
from pa_console.sim.worlds.terrain import Terrain, waiting_distance

LARGEST_M = 5000.0
"""The limit of coordinates on each axis, in metres from the origin."""

MOST_FRAME_M2 = 40_000.0
"""The limit on the sum of all squared frame radii, in m²: four frames of the largest size."""

FieldProblem = tuple[FieldPath, str]
Floats = npt.NDArray[np.float64]
Lines = npt.NDArray[np.object_]


def open_world(name: str) -> tuple[World, Path]:
    """Load a world by installed name or path; return it with its path; raises DocumentError."""
    path = existing_data("worlds", name, "world.yaml")
    return load_world(path), path


def load_world(path: Path) -> World:
    """Read the world at `path`; raises DocumentError for the first problem of form or geometry."""
    document = Document.read(path)
    world = document.parse(World)
    for field, problem in geometry_problems(world):
        raise document.error(field, problem)
    return world


def geometry_problems(world: World) -> Iterator[FieldProblem]:
    """Yield (field, problem and remedy) for everything that cannot be simulated."""
    standing = True
    for source in (_sizes, _polygons, _walls):
        for problem in source(world):
            standing = False
            yield problem
    walls: Lines = np.array(
        [LineString((wall.start, wall.end)) for wall in world.walls], dtype=object
    )
    thick = np.array([wall.thickness_m / 2 for wall in world.walls])
    yield from _frames(world, walls, thick)
    for problem in _lanes(world, walls, thick):
        standing = False
        yield problem
    if standing:
        yield from _posts(world)


def _sizes(world: World) -> Iterator[FieldProblem]:
    """Yield sizes that the simulation cannot represent."""
    limits: list[tuple[FieldPath, float, float, float]] = [
        (("dt_s",), world.dt_s, 0.01, 0.5),
        (("telemetry_period_s",), world.telemetry_period_s, world.dt_s, 60.0),
        (("standoff_m",), world.standoff_m, 0.1, 1000.0),
    ]
    for kind, platform in world.platforms.items():
        field = ("platforms", kind)
        limits.append(((*field, "speed_mps"), platform.speed_mps, 0.05, 100.0))
        limits.append(((*field, "turn_rate_dps"), platform.turn_rate_dps, 1.0, 3600.0))
        limits.append(((*field, "radius_m"), platform.radius_m, 0.05, 20.0))
        limits.append(((*field, "sensor_range_m"), platform.sensor_range_m, 0.1, 10_000.0))
        limits.append(((*field, "position_noise_m"), platform.position_noise_m, 0.0, 1000.0))
    for name, camera in world.cameras.items():
        field = ("cameras", name)
        limits.append(((*field, "sensor_range_m"), camera.sensor_range_m, 0.1, 10_000.0))
        limits.append(((*field, "position_noise_m"), camera.position_noise_m, 0.0, 1000.0))
        limits.append(((*field, "heading_deg"), camera.heading_deg, -360.0, 360.0))
    for name, frame in world.frames.items():
        limits.append((("frames", name, "radius_m"), frame.radius_m, 0.1, 100.0))
    for index, wall in enumerate(world.walls):
        limits.append((("walls", index, "thickness_m"), wall.thickness_m, 0.1, 20.0))
    for field, points in _all_points(world):
        for point in points:
            limits += [(field, value, -LARGEST_M, LARGEST_M) for value in point]
    squares = sum(frame.radius_m**2 for frame in world.frames.values())
    if squares > MOST_FRAME_M2:
        problem = f"their radii are too large together: the sum of the squares is {squares:g} m²"
        yield ("frames",), f"{problem}; it must be at most {MOST_FRAME_M2:g} m²"
    for field, value, least, most in limits:
        if not least <= value <= most:
            yield field, f"{value:g} is out of range; it must be from {least:g} to {most:g}"


def _all_points(world: World) -> Iterator[tuple[FieldPath, tuple[Point, ...]]]:
    yield ("perimeter",), world.perimeter
    for name, zone in world.zones.items():
        yield ("zones", name, "polygon"), zone.polygon
    for name, lane in world.lanes.items():
        yield ("lanes", name, "points"), lane.points
    for name, frame in world.frames.items():
        yield ("frames", name, "at"), (frame.at,)
    for name, camera in world.cameras.items():
        yield ("cameras", name, "at"), (camera.at,)
    for index, wall in enumerate(world.walls):
        yield ("walls", index), (wall.start, wall.end)


def _polygons(world: World) -> Iterator[FieldProblem]:
    named = [(("perimeter",), world.perimeter)]
    named += [(("zones", name, "polygon"), zone.polygon) for name, zone in world.zones.items()]
    for field, points in named:
        polygon = Polygon(points)
        if not polygon.is_valid or polygon.area <= 0.0:
            yield field, "the sides cross or enclose nothing; list the corners in order"


def _walls(world: World) -> Iterator[FieldProblem]:
    for index, wall in enumerate(world.walls):
        if wall.start == wall.end:
            yield ("walls", index, "end"), "start and end are the same point"


def _frames(world: World, walls: Lines, thick: Floats) -> Iterator[FieldProblem]:
    """Yield frames where no ground asset can stand, and overlapping frames, which are ambiguous."""
    ground = [p.radius_m for kind, p in world.platforms.items() if kind != "uav"]
    widest = max(ground, default=0.0)
    for name, frame in world.frames.items():
        gaps = shapely.distance(walls, shapely.Point(frame.at)) - thick
        for index, gap in enumerate(gaps.tolist()):
            if gap < widest:
                yield (
                    ("frames", name, "at"),
                    f"it is {max(gap, 0.0):.1f} m from the face of walls.{index}, but a ground "
                    f"asset needs {widest:g} m; move the frame or the wall",
                )
        for other, spec in world.frames.items():
            if other <= name:
                continue
            gap = math.dist(frame.at, spec.at)
            if gap < frame.radius_m + spec.radius_m:
                yield (
                    ("frames", name, "at"),
                    f"it overlaps {other}, {gap:.1f} m away; move it or make a radius smaller",
                )


def _lanes(world: World, walls: Lines, thick: Floats) -> Iterator[FieldProblem]:
    """Yield lanes that do not lead to the waiting point of their gate, or run through a wall."""
    reach = waiting_distance(world)
    for name, lane in world.lanes.items():
        if any(a == b for a, b in pairwise(lane.points)):
            yield ("lanes", name, "points"), "a point is repeated"
            continue
        line = LineString(lane.points)
        gap = math.dist(lane.points[-1], world.frames[lane.gate].at)
        if gap > reach:
            yield (
                ("lanes", name, "points"),
                f"it ends {gap:.1f} m from {lane.gate}; its last point must be within {reach:g} m",
            )
        for index in np.flatnonzero(shapely.distance(walls, line) < thick).tolist():
            yield ("lanes", name, "points"), f"it runs through walls.{index}"


def _posts(world: World) -> Iterator[FieldProblem]:
    """Yield assets that have no standing place at the frame where they start."""
    terrain = Terrain.of(world)
    posted = Counter((spec.post, spec.kind == "uav") for spec in world.assets.values())
    for name, spec in world.assets.items():
        count = posted[spec.post, spec.kind == "uav"]
        room = len(terrain.places(spec.post, spec.kind))
        if count > room:
            yield (
                ("assets", name, "post"),
                f"{spec.post} has room for {room} such assets, but {count} are posted there; "
                "enlarge its radius_m or post some elsewhere",
            )
