"""The constant geometry of a world: routes, lanes, standing places, near walls."""

import math
from collections.abc import Iterable, Mapping

import shapely
from shapely.geometry import LineString, Polygon

from pa_console.schema.base import Point
from pa_console.schema.world import AssetKind, Frame, Wall, World
from pa_console.sim.contacts.lanes import LaneLine
from pa_console.sim.worlds.platform_limits import platform_limits
from pa_console.sim.worlds.routes import Planner
from pa_console.sim.worlds.sight_lines import Sight

PLACE_GAP_M = 0.8
_CELL_M = 2.0
_FRAME_CELL_M = 16.0
_Cells = dict[tuple[int, int], tuple[tuple[str, Frame], ...]]


class Terrain:
    """Geometry derived from a world; shared by a simulation and all its forks."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.planner = Planner(world)
        self.sight = Sight(world)
        self.limits = platform_limits(world)
        self.gates = world.gates
        self.lanes = {name: LaneLine(world, name) for name in world.lanes}
        self.spacing_m = PLACE_GAP_M + 2 * max(p.radius_m for p in world.platforms.values())
        self._perimeter = Polygon(world.perimeter)
        shapely.prepare(self._perimeter)
        widest = max(p.radius_m for p in world.platforms.values())
        fastest = max(p.speed_mps for p in world.platforms.values())
        self.contact_m = 2 * (widest + fastest * world.dt_s)
        """Two assets with their centres farther apart cannot touch within a step, metres."""
        self._walls = shapely.STRtree([LineString((w.start, w.end)) for w in world.walls])
        self._thickest_m = max((wall.thickness_m for wall in world.walls), default=0.0)
        self._near: dict[tuple[int, int], tuple[Wall, ...]] = {}
        self._frames = _by_cell(world.frames)
        self._places: dict[tuple[str, AssetKind], tuple[Point, ...]] = {}

    def seconds(self, ticks: int) -> float:
        """Return how long `ticks` steps last, free of the noise of binary fractions."""
        return round(ticks * self.world.dt_s, 6)

    def frame_at(self, x: float, y: float) -> str | None:
        """Return the nearest frame within whose radius the point lies."""
        best, name = math.inf, None
        cell = (math.floor(x / _FRAME_CELL_M), math.floor(y / _FRAME_CELL_M))
        for frame, spec in self._frames.get(cell, ()):
            gap = math.hypot(x - spec.at[0], y - spec.at[1])
            if gap <= spec.radius_m and gap < best:
                best, name = gap, frame
        return name

    def lanes_to(self, gate: str) -> tuple[str, ...]:
        """Return the names of the lanes that lead to `gate`."""
        return tuple(name for name, lane in self.world.lanes.items() if lane.gate == gate)

    def near_walls(self, x: float, y: float) -> tuple[Wall, ...]:
        """Return the walls that something at the point may touch within a step (a superset)."""
        cell = (math.floor(x / _CELL_M), math.floor(y / _CELL_M))
        found = self._near.get(cell)
        if found is None:
            centre = shapely.Point((cell[0] + 0.5) * _CELL_M, (cell[1] + 0.5) * _CELL_M)
            reach = self.contact_m + _CELL_M + self._thickest_m / 2
            hits: list[int] = self._walls.query(centre, "dwithin", reach).tolist()
            found = tuple(self.world.walls[index] for index in sorted(hits))
            self._near[cell] = found
        return found

    def places(self, frame: str, kind: AssetKind) -> tuple[Point, ...]:
        """Return the points at `frame` where assets of `kind` can stand apart, innermost first.

        They form a hexagonal grid within the frame's radius, on ground that `kind` can stand on,
        inside the perimeter, and at least the standoff away from where tracks wait (ROE-04).
        """
        key = (frame, kind)
        if key not in self._places:
            self._places[key] = tuple(self._stands(frame, kind))
        return self._places[key]

    def free_place(self, frame: str, kind: AssetKind, taken: Iterable[Point]) -> Point | None:
        """Return the innermost place at `frame` that is clear of `taken`, None if it is full."""
        spec, spare = self.world.frames[frame], self.spacing_m - 0.1
        (x, y), reach = spec.at, spec.radius_m + spare
        others = [p for p in taken if abs(p[0] - x) < reach and abs(p[1] - y) < reach]
        stood_on = set(others)
        free = (
            place
            for place in self.places(frame, kind)
            if place not in stood_on and all(math.dist(place, other) >= spare for other in others)
        )
        return next(free, None)

    def _stands(self, frame: str, kind: AssetKind) -> list[Point]:
        spec = self.world.frames[frame]
        area = self.planner.area(kind, spec.at)
        inside = self._perimeter.covers(shapely.Point(spec.at))
        waits = [self.lanes[lane].waiting_point for lane in self.lanes_to(frame)]
        standoff = self.world.standoff_m + 0.5
        reach = max(0.0, spec.radius_m - 0.5)
        rows = int(reach / self.spacing_m) + 2
        steps = range(-rows, rows + 1)
        grid = [
            (x, y)
            for row in steps
            for y in (spec.at[1] + self.spacing_m * row * math.sqrt(0.75),)
            for x in (spec.at[0] + self.spacing_m * (column + row % 2 / 2) for column in steps)
            if math.dist((x, y), spec.at) <= reach
            and all(math.dist((x, y), wait) >= standoff for wait in waits)
        ]
        if not grid:
            return []
        free = area.contains_all(grid)
        if inside:
            free &= shapely.intersects_xy(self._perimeter, *zip(*grid, strict=True))
        points = [
            (round(x, 6), round(y, 6)) for (x, y), here in zip(grid, free, strict=True) if here
        ]
        return sorted(points, key=lambda p: (round(math.dist(p, spec.at), 6), p))


def _by_cell(frames: Mapping[str, Frame]) -> _Cells:
    """Return which frames reach into each square cell of the ground, in file order."""
    cells: _Cells = {}
    for name, frame in frames.items():
        (x, y), r = frame.at, frame.radius_m
        low_x, high_x, low_y, high_y = (
            math.floor(edge / _FRAME_CELL_M) for edge in (x - r, x + r, y - r, y + r)
        )
        for column in range(low_x, high_x + 1):
            for row in range(low_y, high_y + 1):
                cells[column, row] = (*cells.get((column, row), ()), (name, frame))
    return cells
