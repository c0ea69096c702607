"""Routes around walls and restricted zones, planned on visibility graphs (CAP-09, ROE-07)."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient
from shapely.ops import nearest_points

from pa_console.schema.base import Point
from pa_console.schema.world import AssetKind, Wall, World

CLEARANCE_M = 0.8
"""The distance in metres between the hull of a vehicle on a route and a wall or zone."""
OUTSIDE_MARGIN_M = 60.0
MOST_AREAS = 256
"""The number of areas of free ground that are cached for each world."""
_TOLERANCE_M = 0.01

Route = tuple[Point, ...]
Floats = npt.NDArray[np.float64]


class Area:
    """Free ground, connected or not, with the shortest ways between its corners.

    The ways are computed when they are first needed, so that a world can be read without them.
    """

    def __init__(self, free: BaseGeometry) -> None:
        """Prepare `free` (one or several polygons, in metres) for many queries."""
        self._free = free
        self._tolerant = free.buffer(_TOLERANCE_M)
        shapely.prepare(self._tolerant)
        self._nodes = _corners(free)

    def contains(self, x: float, y: float) -> bool:
        """Return whether the point is free."""
        return bool(shapely.contains_xy(self._tolerant, x, y))

    def contains_all(self, points: Sequence[Point]) -> npt.NDArray[np.bool_]:
        """Return for each of n points whether it is free."""
        return np.atleast_1d(shapely.contains_xy(self._tolerant, np.array(points)))

    def path(self, start: Point, target: Point) -> Route | None:
        """Return the waypoints of the shortest way from `start` to `target`; None if there is none.

        If the start is not free, the way first leads to the nearest free point.
        """
        if not self.contains(*target):
            return None
        lead: Route = ()
        if not self.contains(*start):
            near = nearest_points(self._free, shapely.Point(start))[0]
            start = (near.x, near.y)
            lead = (start,)
        ends = np.array([start, target])
        if self._sees(ends[:1], ends[1:])[0]:
            return (*lead, target)
        way = self._corner_path(ends[0], ends[1])
        return None if way is None else (*lead, *way, target)

    @cached_property
    def _ways(self) -> tuple[Floats, Floats]:
        """The (n, n) lengths of the straight lines between corners, and of the shortest ways."""
        count = len(self._nodes)
        first, second = np.triu_indices(count, k=1)
        seen = self._sees(self._nodes[first], self._nodes[second])
        lengths = np.linalg.norm(self._nodes[first] - self._nodes[second], axis=1)
        edge: Floats = np.full((count, count), np.inf)
        edge[first[seen], second[seen]] = lengths[seen]
        edge[second[seen], first[seen]] = lengths[seen]
        least = edge.copy()
        np.fill_diagonal(least, 0.0)
        for over in range(count):  # Floyd and Warshall: ways over one more corner
            np.minimum(least, least[:, over, None] + least[None, over], out=least)
        return edge, least

    def _corner_path(self, start: Floats, target: Floats) -> Route | None:
        edge, least = self._ways
        out, into = self._reach(start), self._reach(target)
        total = out[:, None] + least + into[None, :]
        if not total.size or not np.isfinite(total.min()):
            return None
        here, last = (int(index) for index in np.unravel_index(int(total.argmin()), total.shape))
        way = [here]
        while here != last:
            here = int((edge[here] + least[:, last]).argmin())
            way.append(here)
        return tuple((float(self._nodes[i, 0]), float(self._nodes[i, 1])) for i in way)

    def _reach(self, point: Floats) -> Floats:
        """Return the distances from `point` to every corner; inf if the corner is not visible."""
        seen = self._sees(np.broadcast_to(point, self._nodes.shape), self._nodes)
        return np.where(seen, np.linalg.norm(self._nodes - point, axis=1), np.inf)

    def _sees(self, starts: Floats, ends: Floats) -> npt.NDArray[np.bool_]:
        """Return, for each pair of (n, 2) points, whether the line between them is free."""
        lines = shapely.linestrings(np.stack((starts, ends), axis=1))
        return np.atleast_1d(shapely.covers(self._tolerant, lines))


class RoutePlanner:
    """Routes for every kind of asset in one world; areas are built on first use and cached."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._perimeter = Polygon(world.perimeter)
        self._zones = {name: Polygon(zone.polygon) for name, zone in world.zones.items()}
        self._boxes = {name: zone.bounds for name, zone in self._zones.items()}
        for polygon in (self._perimeter, *self._zones.values()):
            shapely.prepare(polygon)
        self._areas: dict[tuple[AssetKind, frozenset[str], bool, tuple[Wall, ...]], Area] = {}

    def route(
        self, kind: AssetKind, start: Point, target: Point, avoid: tuple[Wall, ...] = ()
    ) -> Route | None:
        """Return waypoints from `start` (excluded) to `target`, or None if it is unreachable.

        A ground asset keeps clear of walls and of `avoid`, the obstructions that it has detected.
        Restricted zones are avoided unless an end of the route lies inside one; the perimeter is
        left only if an end lies outside it (ROE-06, ROE-07).
        """
        return self.area(kind, start, target, avoid=avoid).path(start, target)

    def area(self, kind: AssetKind, *ends: Point, avoid: tuple[Wall, ...] = ()) -> Area:
        """Return the free ground for `kind` between `ends`, clear of `avoid`."""
        entered = frozenset(
            name
            for name, (left, low, right, high) in self._boxes.items()
            for x, y in ends
            if left <= x <= right and low <= y <= high
            if shapely.intersects_xy(self._zones[name], x, y)
        )
        inside = all(shapely.intersects_xy(self._perimeter, *end) for end in ends)
        key = (kind, entered, inside, avoid)
        area = self._areas.get(key)
        if area is None:
            # Obstructions come and go, and each set of them has its own areas.
            if len(self._areas) >= MOST_AREAS:
                self._areas.pop(next(iter(self._areas)), None)
            area = self._areas[key] = Area(self._free(kind, entered, inside, avoid))
        return area

    def _free(
        self, kind: AssetKind, entered: frozenset[str], inside: bool, avoid: tuple[Wall, ...]
    ) -> BaseGeometry:
        radius = self._world.platforms[kind].radius_m
        obstacles = [
            zone.buffer(radius + CLEARANCE_M, join_style="mitre")
            for name, zone in self._zones.items()
            if name not in entered
        ]
        if kind != "uav":
            obstacles += [
                shapely.LineString((wall.start, wall.end)).buffer(
                    wall.thickness_m / 2 + radius + CLEARANCE_M, cap_style="square"
                )
                for wall in (*self._world.walls, *avoid)
            ]
        if inside:
            ground = self._perimeter.buffer(-radius, join_style="mitre")
        else:
            points = [p for lane in self._world.lanes.values() for p in lane.points]
            points += [frame.at for frame in self._world.frames.values()]
            everything = shapely.MultiPoint([*points, *self._world.perimeter])
            ground = shapely.box(*everything.buffer(OUTSIDE_MARGIN_M).bounds)
        return ground.difference(shapely.union_all(obstacles)).simplify(0.02)


def _corners(free: BaseGeometry) -> Floats:
    """Return the corners (n, 2) of `free` that a shortest way can bend around: the reflex ones."""
    parts = list(free.geoms) if isinstance(free, MultiPolygon) else [free]
    corners: list[Floats] = [np.zeros((0, 2))]
    for part in parts:
        if not isinstance(part, Polygon) or part.is_empty:
            continue
        turned = orient(part)
        for ring in (turned.exterior, *turned.interiors):
            points = np.asarray(ring.coords)[:-1, :2]
            before = points - np.roll(points, 1, axis=0)
            after = np.roll(points, -1, axis=0) - points
            corners.append(points[before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < 0])
    return np.concatenate(corners)
