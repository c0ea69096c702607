"""Moves assets one step; ground vehicles that could touch something go through pymunk.

Contacts have no memory: whatever may touch within the step is put into a fresh space with its
velocity, advanced in small substeps, and read back. So a copy of the positions is a copy of the
physics, and a fork stays exactly equal to its original through contacts too.
"""

import math
from collections.abc import Mapping, Sequence
from math import hypot

import pymunk

from pa_console.schema.world import Wall
from pa_console.sim.assets.surroundings import Traffic
from pa_console.sim.state.scene import AssetState, Scene
from pa_console.sim.worlds.terrain import Terrain

Velocity = tuple[float, float]
CONTACT_MARGIN_M = 0.05
_SUBSTEP_M = 0.05
_OVERLAP_LEFT_PER_S = 1e-9


def move(
    terrain: Terrain,
    scene: Scene,
    ground: Traffic,
    velocities: Mapping[str, Velocity],
    dt_s: float,
) -> None:
    """Advance every asset named in `velocities` (m/s) by `dt_s`; the others stand with brakes on.

    UAVs fly over everything. A ground asset never passes through a wall, an obstruction or
    another one.
    """
    movers = [(scene.assets[name], vx, vy) for name, (vx, vy) in velocities.items()]
    rolling = [(asset, hypot(vx, vy) * dt_s) for asset, vx, vy in movers if asset.kind != "uav"]
    touching, walls = _touching(terrain, scene, ground, rolling)
    fixed = {asset.id for asset in touching} if touching else ()
    for asset, vx, vy in movers:
        if asset.id not in fixed:
            asset.x += vx * dt_s
            asset.y += vy * dt_s
    if touching:
        _collide(terrain, touching, walls, velocities, dt_s)
    if rolling:
        ground.went(max(asset.speed for asset, _ in rolling) * dt_s)


def _touching(
    terrain: Terrain, scene: Scene, ground: Traffic, rolling: Sequence[tuple[AssetState, float]]
) -> tuple[Sequence[AssetState], Sequence[Wall]]:
    """Return the ground assets and walls that may come into contact within the step.

    `rolling` are those that move, each with the metres that it goes.
    """
    steps = {asset.id: step_m for asset, step_m in rolling}
    close: set[str] = set()
    walls: list[Wall] = []
    for mover, step_m in rolling:
        x, y = mover.x, mover.y
        reach = terrain.limits[mover.kind].radius_m + step_m + CONTACT_MARGIN_M
        for other in ground.around(mover).close:
            limit = reach + terrain.limits[other.kind].radius_m + steps.get(other.id, 0.0)
            dx, dy = other.x - x, other.y - y
            if dx * dx + dy * dy < limit * limit:
                close |= {mover.id, other.id}
        near_walls = terrain.near_walls(x, y)
        for wall in (*near_walls, *scene.obstructions) if scene.obstructions else near_walls:
            if gap(wall, x, y) < reach:
                close.add(mover.id)
                if wall not in walls:
                    walls.append(wall)
    return scene.in_order(close) if close else (), walls


def gap(wall: Wall, x: float, y: float) -> float:
    """Return the distance from a point to the face of a wall, metres, negative inside it."""
    (ax, ay), (bx, by) = wall.start, wall.end
    dx, dy = bx - ax, by - ay
    along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)
    along = min(1.0, max(0.0, along))
    return hypot(x - ax - along * dx, y - ay - along * dy) - wall.thickness_m / 2


def _collide(
    terrain: Terrain,
    assets: Sequence[AssetState],
    walls: Sequence[Wall],
    velocities: Mapping[str, Velocity],
    dt_s: float,
) -> None:
    """Advance `assets` among `walls` in a fresh space; assets that stand cannot be pushed."""
    space = pymunk.Space()
    space.collision_slop = 0.01
    space.collision_bias = _OVERLAP_LEFT_PER_S
    space.iterations = 12
    for wall in walls:
        space.add(pymunk.Segment(space.static_body, wall.start, wall.end, wall.thickness_m / 2))
    moving: list[tuple[AssetState, pymunk.Body]] = []
    fastest = 0.0
    for asset in assets:
        radius = terrain.world.platforms[asset.kind].radius_m
        velocity = velocities.get(asset.id)
        if velocity is None:
            space.add(pymunk.Circle(space.static_body, radius, asset.position))
            continue
        mass = radius * radius
        body = pymunk.Body(mass, pymunk.moment_for_circle(mass, 0.0, radius))
        body.position, body.velocity = asset.position, velocity
        space.add(body, pymunk.Circle(body, radius))
        moving.append((asset, body))
        fastest = max(fastest, hypot(*velocity))
    substeps = max(3, math.ceil(fastest * dt_s / _SUBSTEP_M))
    for _ in range(substeps):
        space.step(dt_s / substeps)
    for asset, body in moving:
        x, y = body.position
        asset.speed = hypot(x - asset.x, y - asset.y) / dt_s
        asset.x, asset.y = x, y
