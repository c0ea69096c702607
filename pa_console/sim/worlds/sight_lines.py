"""The constant geometry of sight in a world: walls in the way, the perimeter, lanes by place."""

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import LineString, Polygon

from pa_console.schema.base import Point
from pa_console.schema.world import World

Floats = npt.NDArray[np.float64]


class Sight:
    """Geometry for sensing in one world; shared by a simulation and all its forks."""

    def __init__(self, world: World) -> None:
        self._walls = shapely.STRtree([LineString((wall.start, wall.end)) for wall in world.walls])
        self._perimeter = Polygon(world.perimeter)
        shapely.prepare(self._perimeter)
        self._edge = self._perimeter.exterior
        self._lane_gates = [lane.gate for lane in world.lanes.values()]
        lanes = [LineString(lane.points) for lane in world.lanes.values()]
        self._lanes = np.array(lanes, dtype=object)
        self._gate_at = np.array([world.frames[gate].at for gate in world.gates])
        self._gates = world.gates

    def clear(self, eyes: Floats, targets: Floats) -> npt.NDArray[np.bool_]:
        """Return, for each pair of (n, 2) points, whether no wall lies between the two."""
        clear = np.ones(len(eyes), dtype=np.bool_)
        if len(eyes):
            lines = shapely.linestrings(np.stack((eyes, targets), axis=1))
            clear[self._walls.query(lines, predicate="intersects")[0]] = False
        return clear

    def depth(self, point: Point) -> float:
        """Return how far inside the perimeter a point lies, metres; negative outside it."""
        gap = float(shapely.distance(self._edge, shapely.Point(point)))
        return gap if shapely.contains_xy(self._perimeter, *point) else -gap

    def gate_of(self, point: Point) -> str:
        """Return the gate of the lane nearest to a point; without lanes the nearest gate."""
        if len(self._lanes):
            return self._lane_gates[
                int(np.argmin(shapely.distance(self._lanes, shapely.Point(point))))
            ]
        return self._gates[int(np.argmin(np.linalg.norm(self._gate_at - point, axis=1)))]
