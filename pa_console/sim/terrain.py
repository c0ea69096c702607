"""What never changes while a world is simulated: routes, lanes, standing places, near walls."""

import math
from collections.abc import Iterable

import shapely
from shapely.geometry import Polygon

from pa_console.schema.base import Point
from pa_console.schema.world import AssetKind, Wall, World
from pa_console.sim.lanes import LaneLine
from pa_console.sim.routes import Planner
from pa_console.sim.sight import Sight

PLACE_GAP_M = 0.8
_CELL_M = 2.0


class Terrain:
    """Geometry derived from a world; shared by a simulation and all its forks."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.planner = Planner(world)
        self.sight = Sight(world)
        self.lanes = {name: LaneLine(world, name) for name in world.lanes}
        self.spacing_m = PLACE_GAP_M + 2 * max(p.radius_m for p in world.platforms.values())
        self._perimeter = Polygon(world.perimeter)
        self._widest_m = max(p.radius_m for p in world.platforms.values())
        self._fastest_mps = max(p.speed_mps for p in world.platforms.values())
        self._near: dict[tuple[int, int], tuple[Wall, ...]] = {}
        self._places: dict[tuple[str, AssetKind], tuple[Point, ...]] = {}

    def seconds(self, ticks: int) -> float:
        """Return how long `ticks` steps last, free of the noise of binary fractions."""
        return round(ticks * self.world.dt_s, 6)

    def frame_at(self, x: float, y: float) -> str | None:
        """Return the nearest frame within whose radius the point lies."""
        best, name = math.inf, None
        for frame, spec in self.world.frames.items():
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
            reach = self._widest_m + 2 * self._fastest_mps * self.world.dt_s + _CELL_M
            found = tuple(
                wall
                for wall in self.world.walls
                if shapely.LineString((wall.start, wall.end)).distance(centre)
                <= reach + wall.thickness_m / 2
            )
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

    def free_place(
        self, frame: str, kind: AssetKind, taken: Iterable[Point], near: Point | None = None
    ) -> Point | None:
        """Return a place at `frame` clear of `taken`, the innermost or the nearest to `near`."""
        others = tuple(taken)
        spare = self.spacing_m - 0.1
        free = (
            place
            for place in self.places(frame, kind)
            if all(math.dist(place, other) >= spare for other in others)
        )
        if near is None:
            return next(free, None)
        return min(free, key=lambda place: math.dist(place, near), default=None)

    def _stands(self, frame: str, kind: AssetKind) -> list[Point]:
        spec = self.world.frames[frame]
        area = self.planner.area(kind, spec.at)
        inside = self._perimeter.covers(shapely.Point(spec.at))
        waits = [self.lanes[lane].waiting_point for lane in self.lanes_to(frame)]
        standoff = self.world.standoff_m + 0.5
        reach = max(0.0, spec.radius_m - 0.5)
        rows = int(reach / self.spacing_m) + 2
        points: list[Point] = []
        for row in range(-rows, rows + 1):
            for column in range(-rows, rows + 1):
                x = spec.at[0] + self.spacing_m * (column + row % 2 / 2)
                y = spec.at[1] + self.spacing_m * row * math.sqrt(0.75)
                if (
                    math.dist((x, y), spec.at) <= reach
                    and area.contains(x, y)
                    and (not inside or self._perimeter.covers(shapely.Point(x, y)))
                    and all(math.dist((x, y), wait) >= standoff for wait in waits)
                ):
                    points.append((round(x, 6), round(y, 6)))
        return sorted(points, key=lambda p: (round(math.dist(p, spec.at), 6), p))
