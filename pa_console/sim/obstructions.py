"""Things that come to lie across the ground: nobody knows of them until an asset runs into one."""

import math
from collections.abc import Iterable

from pa_console.schema.base import Point
from pa_console.schema.incident import Incident, ObstructWay
from pa_console.schema.world import Wall
from pa_console.sim.state import AssetState, Scene
from pa_console.sim.terrain import Terrain

THICKNESS_M = 0.8
SEEN_M = 3.0
"""A ground asset that cannot go on has seen what lies this near to its hull."""


def apply(terrain: Terrain, scene: Scene, incident: Incident) -> bool:
    """Put an obstruction on the ground; return whether `incident` was about one.

    Raises ValueError when it has no length or would lie on a ground asset.
    """
    if not isinstance(incident, ObstructWay):
        return False
    if incident.start == incident.end:
        raise ValueError("the obstruction's start and end are the same point")
    wall = Wall(start=incident.start, end=incident.end, thickness_m=THICKNESS_M)
    for asset in scene.assets.values():
        radius = terrain.world.platforms[asset.kind].radius_m
        if asset.kind != "uav" and gap(wall, asset.x, asset.y) < radius:
            raise ValueError(f"{asset.id} stands where the obstruction would lie")
    scene.obstructions = (*scene.obstructions, wall)
    return True


def seen_from(
    terrain: Terrain, asset: AssetState, obstructions: Iterable[Wall]
) -> tuple[Wall, ...]:
    """Return the obstructions that a ground asset notices from where it stands."""
    reach = terrain.world.platforms[asset.kind].radius_m + SEEN_M
    return tuple(wall for wall in obstructions if gap(wall, asset.x, asset.y) <= reach)


def gap(wall: Wall, x: float, y: float) -> float:
    """Return the distance from a point to the face of a wall, metres, negative inside it."""
    foot = nearest(wall.start, wall.end, (x, y))
    return math.hypot(x - foot[0], y - foot[1]) - wall.thickness_m / 2


def nearest(start: Point, end: Point, point: Point) -> Point:
    """Return the point of the segment from `start` to `end` that lies nearest to `point`."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    along = ((point[0] - start[0]) * dx + (point[1] - start[1]) * dy) / (dx * dx + dy * dy)
    along = min(1.0, max(0.0, along))
    return (start[0] + along * dx, start[1] + along * dy)
