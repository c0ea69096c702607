"""The constant geometry of a world: routes, lanes, lines of sight, places and nearby walls."""

import math
import threading
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import LineString, Polygon

from pa_console.schema.base import Point
from pa_console.schema.world import AssetKind, Frame, Wall, World
from pa_console.sim.worlds.routes import RoutePlanner

LOOK_M = 5.0
LOOK_S = 2.0
"""The travel time in seconds for which a ground asset looks ahead, though at most LOOK_M metres."""
HULL_GAP_M = 0.15
_CORNER_M: dict[AssetKind, float] = {"uav": 1.5, "ugv": 0.5, "robot": 0.4}

WAITING_STANDOFFS = 1.5
"""The distance from their gate, in standoffs, at which tracks wait, so that an asset at the gate
complies with ROE-04."""
QUEUE_GAP_M = 8.0
_SEARCH_STEP_M = 0.25
PLACE_GAP_M = 0.8
_CELL_M = 2.0
_FRAME_CELL_M = 16.0
Floats = npt.NDArray[np.float64]
_Cells = dict[tuple[int, int], tuple[tuple[str, Frame], ...]]


@dataclass(frozen=True, slots=True)
class PlatformLimits:
    """The limits of one kind of asset, in metres, metres per second and radians.

    An asset may turn by at most `turn_rad` in a step. A corner of its route counts as passed within
    `corner_m`. It looks for other assets within `look_m`; `apart_m` has, for each kind of asset,
    the least distance between the centres.
    """

    flies: bool
    radius_m: float
    speed_mps: float
    turn_rad: float
    corner_m: float
    look_m: float
    apart_m: dict[AssetKind, float]


def platform_limits(world: World) -> dict[AssetKind, PlatformLimits]:
    """Return the limits of every kind of asset that `world` has a platform for."""
    return {
        kind: PlatformLimits(
            flies=kind == "uav",
            radius_m=platform.radius_m,
            speed_mps=platform.speed_mps,
            turn_rad=math.radians(platform.turn_rate_dps) * world.dt_s,
            corner_m=_CORNER_M[kind],
            look_m=min(LOOK_M, platform.speed_mps * LOOK_S) + platform.radius_m,
            apart_m={
                other: platform.radius_m + other_platform.radius_m + HULL_GAP_M
                for other, other_platform in world.platforms.items()
            },
        )
        for kind, platform in world.platforms.items()
    }


def waiting_distance(world: World) -> float:
    """Return the distance in metres between a waiting track and the frame of its gate."""
    return WAITING_STANDOFFS * world.standoff_m


class LaneLine:
    """A lane; positions on it are in metres travelled from its far end."""

    def __init__(self, world: World, name: str) -> None:
        lane = world.lanes[name]
        self._points = lane.points
        self._gate = world.frames[lane.gate].at
        steps = [math.dist(a, b) for a, b in pairwise(lane.points)]
        self._marks = list(accumulate(steps, initial=0.0))
        self.length_m = self._marks[-1]
        self.waiting_m = self.first_within(waiting_distance(world))
        """Metres from the far end to the waiting point, or the length of a lane that ends before
        it."""
        self.waiting_point: Point = self.locate(self.waiting_m)[0]

    def first_within(self, distance_m: float) -> float:
        """Return the metres travelled at the lane's first point within `distance_m` of the gate."""
        index, last = 0, math.ceil(self.length_m / _SEARCH_STEP_M)
        while index <= last:
            travelled = min(index * _SEARCH_STEP_M, self.length_m)
            far = math.dist(self.locate(travelled)[0], self._gate) - distance_m - 1e-9
            if far <= 0.0:
                return travelled
            # A metre travelled brings the lane at most a metre nearer, so the search may skip.
            index += max(1, int((far - 1e-6) / _SEARCH_STEP_M))
        return self.length_m

    def locate(self, travelled_m: float) -> tuple[Point, float]:
        """Return the position and the heading (radians, toward the gate) at `travelled_m`."""
        at = min(max(travelled_m, 0.0), self.length_m)
        leg = min(max(bisect_right(self._marks, at) - 1, 0), len(self._points) - 2)
        (ax, ay), (bx, by) = self._points[leg], self._points[leg + 1]
        part = (at - self._marks[leg]) / (self._marks[leg + 1] - self._marks[leg])
        point = (ax + (bx - ax) * part, ay + (by - ay) * part)
        return point, math.atan2(by - ay, bx - ax)


class Terrain:
    """Geometry derived from a world, which all simulations of the world and their forks share."""

    @classmethod
    def of(cls, world: World) -> "Terrain":
        """Return the geometry of `world`; the geometries used most recently are cached."""
        for terrain in _recent.terrains:
            if terrain.world is world:
                return terrain
        terrain = cls(world)
        _recent.terrains.append(terrain)
        return terrain

    def __init__(self, world: World) -> None:
        self.world = world
        self.planner = RoutePlanner(world)
        self.limits = platform_limits(world)
        self.gates = world.gates
        self.lanes = {name: LaneLine(world, name) for name in world.lanes}
        self.spacing_m = PLACE_GAP_M + 2 * max(p.radius_m for p in world.platforms.values())
        self._perimeter = Polygon(world.perimeter)
        shapely.prepare(self._perimeter)
        self._edge = self._perimeter.exterior
        widest = max(p.radius_m for p in world.platforms.values())
        fastest = max(p.speed_mps for p in world.platforms.values())
        self.contact_m = 2 * (widest + fastest * world.dt_s)
        """The largest distance, in metres, between the centres of two assets that may touch in a
        step."""
        self._walls = shapely.STRtree([LineString((w.start, w.end)) for w in world.walls])
        lanes = [LineString(lane.points) for lane in world.lanes.values()]
        self._lane_lines = np.array(lanes, dtype=object)
        self._lane_gates = [lane.gate for lane in world.lanes.values()]
        self._gate_at = np.array([world.frames[gate].at for gate in world.gates])
        self._thickest_m = max((wall.thickness_m for wall in world.walls), default=0.0)
        self._near: dict[tuple[int, int], tuple[Wall, ...]] = {}
        self._frames = _by_cell(world.frames)
        self._places: dict[tuple[str, AssetKind], tuple[Point, ...]] = {}
        self._latest = (0, 0.0)

    def seconds(self, ticks: int) -> float:
        """Return the duration of `ticks` steps without the noise of binary fractions."""
        latest = self._latest
        if latest[0] != ticks:
            latest = self._latest = (ticks, round(ticks * self.world.dt_s, 6))
        return latest[1]

    def frame_at(self, x: float, y: float) -> str | None:
        """Return the nearest frame whose radius includes the point, or None."""
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
        """Return the walls that an asset at the point may touch within a step (a superset)."""
        cell = (math.floor(x / _CELL_M), math.floor(y / _CELL_M))
        walls = self._near.get(cell)
        if walls is None:
            centre = shapely.Point((cell[0] + 0.5) * _CELL_M, (cell[1] + 0.5) * _CELL_M)
            reach = self.contact_m + _CELL_M + self._thickest_m / 2
            hits: list[int] = self._walls.query(centre, "dwithin", reach).tolist()
            walls = tuple(self.world.walls[index] for index in sorted(hits))
            self._near[cell] = walls
        return walls

    def places(self, frame: str, kind: AssetKind) -> tuple[Point, ...]:
        """Return the points at `frame` where assets of `kind` can stand apart, innermost first.

        They form a hexagonal grid within the frame's radius, on free ground for `kind`, inside the
        perimeter, and at least the standoff away from the tracks' waiting points (ROE-04).
        """
        key = (frame, kind)
        if key not in self._places:
            self._places[key] = tuple(self._stands(frame, kind))
        return self._places[key]

    def free_place(self, frame: str, kind: AssetKind, taken: Iterable[Point]) -> Point | None:
        """Return the innermost place at `frame` clear of `taken`, or None if there is none."""
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

    def in_sight(self, eyes: Floats, targets: Floats) -> npt.NDArray[np.bool_]:
        """Return, for each pair of (n, 2) points, whether no wall lies between them."""
        clear = np.ones(len(eyes), dtype=np.bool_)
        if len(eyes):
            lines = shapely.linestrings(np.stack((eyes, targets), axis=1))
            clear[self._walls.query(lines, predicate="intersects")[0]] = False
        return clear

    def depth(self, point: Point) -> float:
        """Return the distance of a point from the perimeter in metres; negative outside."""
        gap = float(shapely.distance(self._edge, shapely.Point(point)))
        return gap if shapely.contains_xy(self._perimeter, *point) else -gap

    def gate_of(self, point: Point) -> str:
        """Return the gate of the lane nearest to a point; without lanes, the gate nearest to it."""
        if len(self._lane_lines):
            return self._lane_gates[
                int(np.argmin(shapely.distance(self._lane_lines, shapely.Point(point))))
            ]
        return self.gates[int(np.argmin(np.linalg.norm(self._gate_at - point, axis=1)))]


class _Recent(threading.local):
    """The recent geometry of a thread; threads share none, because geometry changes in use."""

    def __init__(self) -> None:
        self.terrains: deque[Terrain] = deque(maxlen=16)


_recent = _Recent()


def _by_cell(frames: Mapping[str, Frame]) -> _Cells:
    """Return the frames that reach into each square cell of the ground, in file order."""
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
