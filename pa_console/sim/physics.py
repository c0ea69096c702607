"""One step of motion; ground vehicles that could touch something are moved by pymunk.

Collisions have no memory: all bodies that may touch within the step are put into a new space with
their velocities, advanced in small substeps, and read back. So a copy of the positions is a copy of
the physics, and a fork stays exactly equal to its original through collisions too.

The neighbours of an asset are searched with a margin of some metres, and are reused until an asset
has moved half the margin (a Verlet list), so most steps need no search.
"""

import math
from collections.abc import Iterable, Mapping, Sequence, Set
from math import hypot
from typing import NamedTuple

import pymunk

from pa_console.schema.world import Wall
from pa_console.sim.scene import AssetState, Scene
from pa_console.sim.worlds.terrain import Terrain

_HOLDS_M = 2.0
"""The distance that an asset may move before a search result is outdated, in metres."""
_SPARE_M = 2 * _HOLDS_M + 0.01
_FEW = 16
"""The largest number of assets that are compared one by one instead of by cells."""

_Cell = tuple[int, int]

CONTACT_MARGIN_M = 0.05
_SUBSTEP_M = 0.05
_OVERLAP_LEFT_PER_S = 1e-9
Velocity = tuple[float, float]


class Neighbours(NamedTuple):
    """The assets that a ground asset may give way to or touch, and some that are farther away.

    The lists are reused until an asset may have moved more than `until_m` metres since the
    `Traffic` was created.
    """

    near: list[AssetState]
    close: list[AssetState]
    until_m: float


class Traffic:
    """The ground assets of a team and their neighbours."""

    def __init__(
        self, assets: Iterable[AssetState], standing_m: float, moving_m: float, close_m: float
    ) -> None:
        """Search `assets` within the distances for standing and for moving neighbours.

        Neighbours within `close_m` are close. A standing neighbour comes no nearer by itself, so it
        needs only half the margin.
        """
        self._standing_m, self._moving_m = standing_m + _SPARE_M / 2, moving_m + _SPARE_M
        self._close_m = close_m + _SPARE_M
        self._cell_m = max(self._moving_m, self._close_m) + _SPARE_M
        self._moving: set[str] = set()
        self._ground = [asset for asset in assets if asset.kind != "uav"]
        self._gone_m = self._sorted_until_m = 0.0
        self._cells: dict[_Cell, list[AssetState]] = {}
        self._neighbours: dict[str, Neighbours] = {}
        self.waiting: dict[str, tuple[object, ...] | None] = {}
        """The last situation in which each asset found no free direction.

        In an equal situation, it would find none again.
        """

    def went(self, metres: float) -> None:
        """Record that no asset has moved more than `metres` in this step."""
        self._gone_m += metres

    def go(self, names: Set[str]) -> None:
        """Record that only the assets `names` may move in this step."""
        if not names <= self._moving:
            self._moving = set(names)
            self._neighbours.clear()

    def around(self, asset: AssetState) -> Neighbours:
        """Return the neighbours of `asset`."""
        neighbours = self._neighbours.get(asset.id)
        if neighbours is None or self._gone_m > neighbours.until_m:
            neighbours = self._neighbours[asset.id] = self._look_up(asset)
        return neighbours

    def _look_up(self, asset: AssetState) -> Neighbours:
        neighbours = Neighbours([], [], self._gone_m + _HOLDS_M)
        x, y, widest_m = asset.x, asset.y, max(self._moving_m, self._close_m)
        for other in self._ground if len(self._ground) <= _FEW else self._in_cells(asset):
            gap = math.hypot(other.x - x, other.y - y)
            if gap > widest_m or other is asset:
                continue
            if gap <= (self._moving_m if other.id in self._moving else self._standing_m):
                neighbours.near.append(other)
            if gap <= self._close_m:
                neighbours.close.append(other)
        return neighbours

    def _in_cells(self, asset: AssetState) -> Iterable[AssetState]:
        """Return the assets in the nine cells around `asset`; the cells are reused, too."""
        if not self._cells or self._gone_m > self._sorted_until_m:
            self._cells = {}
            for other in self._ground:
                self._cells.setdefault(self._cell(other), []).append(other)
            self._sorted_until_m = self._gone_m + _HOLDS_M
        column, row = self._cell(asset)
        return [
            other
            for i in (column - 1, column, column + 1)
            for j in (row - 1, row, row + 1)
            for other in self._cells.get((i, j), ())
        ]

    def _cell(self, asset: AssetState) -> _Cell:
        return math.floor(asset.x / self._cell_m), math.floor(asset.y / self._cell_m)


def move(
    terrain: Terrain,
    scene: Scene,
    ground: Traffic,
    velocities: Mapping[str, Velocity],
    dt_s: float,
) -> None:
    """Advance every asset in `velocities` (m/s) by `dt_s`; all others stand with brakes on.

    UAVs fly over everything. A ground asset never passes through a wall, an obstruction or another
    ground asset.
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
    """Return the ground assets and walls that may collide within the step.

    `rolling` has the moving assets, each with its distance in metres.
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
    """Return the distance from a point to the face of a wall in metres; negative inside it."""
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
    """Advance `assets` among `walls` in a new space; standing assets cannot be pushed."""
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
