"""Lanes as lines that tracks drive along, and where on them a track waits for its gate."""

import math
from bisect import bisect_right
from itertools import accumulate, pairwise

from pa_console.schema.base import Point
from pa_console.schema.world import World

WAITING_STANDOFFS = 1.5
"""Tracks wait this many standoffs from their gate, so an asset at the gate keeps ROE-04."""
QUEUE_GAP_M = 8.0
_SEARCH_STEP_M = 0.25


def waiting_distance(world: World) -> float:
    """Return how far from its gate's frame a track comes to a stop, metres."""
    return WAITING_STANDOFFS * world.standoff_m


class LaneLine:
    """One lane, addressed by the metres travelled from its far end."""

    def __init__(self, world: World, name: str) -> None:
        lane = world.lanes[name]
        self._points = lane.points
        self._gate = world.frames[lane.gate].at
        steps = [math.dist(a, b) for a, b in pairwise(lane.points)]
        self._marks = list(accumulate(steps, initial=0.0))
        self.length_m = self._marks[-1]
        self.waiting_m = self.first_within(waiting_distance(world))
        """Metres from the far end to where a track waits; the lane's end if it stops earlier."""
        self.waiting_point: Point = self.locate(self.waiting_m)[0]

    def first_within(self, distance_m: float) -> float:
        """Return the metres travelled when first within `distance_m` of the gate's frame."""
        index, last = 0, math.ceil(self.length_m / _SEARCH_STEP_M)
        while index <= last:
            travelled = min(index * _SEARCH_STEP_M, self.length_m)
            far = math.dist(self.locate(travelled)[0], self._gate) - distance_m - 1e-9
            if far <= 0.0:
                return travelled
            index += max(1, int((far - 1e-6) / _SEARCH_STEP_M))  # a metre brings it a metre nearer
        return self.length_m

    def locate(self, travelled_m: float) -> tuple[Point, float]:
        """Return the position and the heading (radians, toward the gate) at `travelled_m`."""
        at = min(max(travelled_m, 0.0), self.length_m)
        leg = min(max(bisect_right(self._marks, at) - 1, 0), len(self._points) - 2)
        (ax, ay), (bx, by) = self._points[leg], self._points[leg + 1]
        part = (at - self._marks[leg]) / (self._marks[leg + 1] - self._marks[leg])
        point = (ax + (bx - ax) * part, ay + (by - ay) * part)
        return point, math.atan2(by - ay, bx - ax)
