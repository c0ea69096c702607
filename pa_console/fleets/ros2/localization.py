"""The place and the speed of a robot, from the transforms and the odometry that it publishes."""

from collections.abc import Iterable
from typing import NamedTuple

from pa_console.fleets.ros2.messages import Planar, Stamped

MOST_FRAMES = 256
"""Frames of one robot that are kept; a robot with arms has about fifty."""


class Place(NamedTuple):
    """A place on the robot's map."""

    pose: Planar
    stamp: float
    """When it was there, seconds on the robot's clock."""
    arrived_s: float
    """When that came in, on the station's monotonic clock."""


class Localization:
    """Keeps the newest transform of each frame; `place` follows them from the robot to its map."""

    def __init__(self, map_frame: str, base_frame: str) -> None:
        self._map, self._base = map_frame, base_frame
        self._parents: dict[str, Stamped] = {}
        self.place: Place | None = None
        """The place of the robot, None while it is not known."""

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
        if (found := self._chain()) is not None:
            self.move(*found, now_s)

    def move(self, pose: Planar, stamp: float, now_s: float) -> None:
        """Take in a place; one that is older than what is known changes nothing."""
        if self.place is None or stamp > self.place.stamp:
            self.place = Place(pose, stamp, now_s)

    def _chain(self) -> tuple[Planar, float] | None:
        """Return the robot's pose on the map, and when that was; None while a transform is missing.

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
                return pose, stamp
        return None
