"""The fields of view of cameras and assets in clear weather, cut by walls."""

from collections.abc import Iterator
from functools import lru_cache
from math import atan2, ceil, cos, degrees, floor, inf, radians, sin
from typing import Literal

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import AssetKind, World
from pa_console.tui.status_words import Reliance

RAY_DEG = 7.5
"""The angle between two rays of an outline."""

OVER_WALLS: AssetKind = "uav"
"""The kind of asset whose sight no wall blocks."""

FULL_DEG = 360.0


Sensors = Literal["", "cameras", "all"]
"""The sensors whose fields of view are shown."""


Line = tuple[Point, Point]


def camera_fields(world: World, picture: Picture, look: Reliance) -> Iterator[tuple[Point, ...]]:
    """Yield the outline of what each camera sees that works, a closed line in metres."""
    walls = tuple((wall.start, wall.end) for wall in world.walls)
    for name, camera in world.cameras.items():
        report = picture.cameras.get(name)
        if report is not None and look.camera(report) == "works":
            reach, width = camera.sensor_range_m, camera.field_of_view_deg
            yield outline(camera.at, camera.heading_deg, reach, width, walls=walls)


def asset_fields(world: World, picture: Picture, look: Reliance) -> Iterator[tuple[Point, ...]]:
    """Yield the outline of what each asset sees that can be relied on, a closed line in metres."""
    walls = tuple((wall.start, wall.end) for wall in world.walls)
    for asset in picture.assets.values():
        sensor = world.platforms.get(asset.kind)
        if sensor is not None and asset.available and look.report(asset) == "fresh":
            reach, width = sensor.sensor_range_m, sensor.field_of_view_deg
            around = () if asset.kind == OVER_WALLS else walls
            yield outline(asset.position, asset.heading_deg, reach, width, walls=around)


@lru_cache(maxsize=256)
def outline(
    at: Point, heading_deg: float, reach_m: float, width_deg: float, *, walls: tuple[Line, ...]
) -> tuple[Point, ...]:
    """Return the edge of what a sensor sees, a closed line in metres; `walls` block its sight.

    `width_deg` is its field of view.
    """
    count = max(round(width_deg / RAY_DEG), 2)
    step, first_deg = width_deg / count, heading_deg - width_deg / 2
    turns = [radians(first_deg + step * number) for number in range(count + 1)]
    rays = [(cos(turn), sin(turn)) for turn in turns]
    reaches = [reach_m] * len(rays)
    for wall in walls:
        for number in _rays_towards(at, wall, first_deg, step, count):
            reaches[number] = min(reaches[number], _meets(at, rays[number], wall))
    edge = [(at[0] + x * far, at[1] + y * far) for (x, y), far in zip(rays, reaches, strict=True)]
    return tuple(edge) if width_deg >= FULL_DEG else (at, *edge, at)


def _rays_towards(
    at: Point, wall: Line, first_deg: float, step_deg: float, count: int
) -> Iterator[int]:
    """Yield the numbers of the rays, of 0 to `count`, that may meet a wall."""
    start, end = (degrees(atan2(y - at[1], x - at[0])) for x, y in wall)
    width = (end - start + FULL_DEG / 2) % FULL_DEG - FULL_DEG / 2
    offset = (min(start, start + width) - first_deg) % FULL_DEG
    for begin in (offset - FULL_DEG, offset):
        low, high = ceil(begin / step_deg), floor((begin + abs(width)) / step_deg)
        yield from range(max(low, 0), min(high, count) + 1)


def _meets(at: Point, ray: Point, wall: Line) -> float:
    """Return how far away a ray meets a wall, in metres; infinite if it does not."""
    (start_x, start_y), (end_x, end_y) = wall
    x, y, along_x, along_y = start_x - at[0], start_y - at[1], end_x - start_x, end_y - start_y
    cross = ray[0] * along_y - ray[1] * along_x
    if cross == 0.0:
        return inf
    share, far = (x * ray[1] - y * ray[0]) / cross, (x * along_y - y * along_x) / cross
    return far if far > 0.0 and 0.0 <= share <= 1.0 else inf
