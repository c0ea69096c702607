"""The place and the speed of a robot, from the transforms and the odometry that it publishes."""

import math
from collections.abc import Iterable
from typing import NamedTuple

from pa_console.fleets.ros2.messages import Planar, Stamped

MOST_FRAMES = 256
"""Frames of one robot that are kept; a robot with arms has about fifty."""

NEAR_S = 0.5
"""A measured speed holds this long before and after its time, seconds."""

APART_S = 0.4
"""The least time between two poses from which a speed is estimated, seconds."""


class Place(NamedTuple):
    """A place on the robot's map."""

    pose: Planar
    stamp: float
    """When it was there, seconds on the robot's clock."""
    arrived_s: float
    """When that came in, on the station's monotonic clock."""


class Localization:
    """Keeps the newest transform of each frame; `place` follows them from the robot to its map."""

    def __init__(self, map_frame: str, base_frame: str, source: str) -> None:
        """`source` is the topic that the place is read from: `tf`, `odom` or `amcl_pose`."""
        self._map, self._base, self._source = map_frame, base_frame, source
        self._parents: dict[str, Stamped] = {}
        self._before: Place | None = None
        self._measured = (-math.inf, 0.0, -math.inf)
        """The latest speed by odometry: time on the robot's clock, speed, and arrival."""
        self._estimated_mps = 0.0
        self.place: Place | None = None
        """The place of the robot, None while it is not known."""

    def speed(self, place: Place) -> tuple[float, float]:
        """Return the speed at a place, metres a second, and when that came in (monotonic).

        It is the one that odometry measured, else the one between two places.
        """
        stamp, speed_mps, arrived_s = self._measured
        if abs(stamp - place.stamp) <= NEAR_S:
            return speed_mps, min(arrived_s, place.arrived_s)
        return self._estimated_mps, place.arrived_s

    def see_transforms(
        self, transforms: Iterable[Stamped], now_s: float, *, fixed: bool = False
    ) -> None:
        """Take in transforms; one that is older than what is known of its frame changes nothing.

        A `fixed` one holds at any time: the place is not as old as that.
        """
        for each in transforms:
            if fixed:
                each = each._replace(stamp=0.0)  # noqa: PLW2901
            known = self._parents.get(each.child)
            if known is None and len(self._parents) >= MOST_FRAMES:
                continue
            if known is None or each.stamp >= known.stamp:
                self._parents[each.child] = each
        if self._source == "tf" and (found := self._chain()) is not None:
            self.move(found.pose, found.stamp, now_s)

    def see_speed(self, speed_mps: float, stamp: float, now_s: float) -> None:
        """Take in a speed that odometry has measured."""
        self._measured = (stamp, speed_mps, now_s)

    def move(self, pose: Planar, stamp: float, now_s: float) -> None:
        """Take in a place; one that is older than what is known changes nothing."""
        if self.place is not None and stamp <= self.place.stamp:
            return
        self.place = Place(pose, stamp, now_s)
        if self._before is None:
            self._before = self.place
        elif stamp - self._before.stamp >= APART_S:
            apart_m = math.dist(pose[:2], self._before.pose[:2])
            self._estimated_mps = apart_m / (stamp - self._before.stamp)
            self._before = self.place

    def _chain(self) -> Stamped | None:
        """Return the robot's pose on the map, None while a transform is missing.

        It is as old as the transform nearest to the robot that moves: localization stamps the
        map's own transform with a time ahead of now.
        """
        pose, stamp, frame = Planar(0.0, 0.0, 0.0), 0.0, self._base
        for _ in range(len(self._parents)):
            step = self._parents.get(frame)
            if step is None:
                return None
            pose, frame = step.pose.then(pose), step.parent
            stamp = stamp or step.stamp
            if frame == self._map:
                return Stamped(self._map, self._base, pose, stamp)
        return None
