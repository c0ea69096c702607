"""What cameras and assets can see in clear weather: range and field of view, cut by walls."""

from collections.abc import Iterator
from functools import lru_cache
from math import cos, inf, radians, sin
from typing import Literal

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import AssetKind, World
from pa_console.tui.report_condition import Reliance

RAY_DEG = 5.0
"""The angle between two rays of an outline."""

OVER_WALLS: AssetKind = "uav"
"""The kind of asset whose sight no wall blocks."""

FULL_DEG = 360.0


Sensors = Literal["", "cameras", "all"]
"""Of which sensors the fields of view are shown."""


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
    edge: list[Point] = []
    for number in range(count + 1):
        turn = radians(heading_deg - width_deg / 2 + width_deg * number / count)
        ray = cos(turn), sin(turn)
        far = min((_meets(at, ray, wall) for wall in walls), default=inf)
        far = min(far, reach_m)
        edge.append((at[0] + ray[0] * far, at[1] + ray[1] * far))
    return tuple(edge) if width_deg >= FULL_DEG else (at, *edge, at)


def _meets(at: Point, ray: Point, wall: Line) -> float:
    """Return how far away a ray meets a wall, in metres; infinite if it does not."""
    (start_x, start_y), (end_x, end_y) = wall
    x, y, along_x, along_y = start_x - at[0], start_y - at[1], end_x - start_x, end_y - start_y
    cross = ray[0] * along_y - ray[1] * along_x
    if cross == 0.0:
        return inf
    share, far = (x * ray[1] - y * ray[0]) / cross, (x * along_y - y * along_x) / cross
    return far if far > 0.0 and 0.0 <= share <= 1.0 else inf
