"""The place of a robot on its map, from the transforms or poses that it publishes."""

from collections.abc import Iterable
from typing import NamedTuple

from pa_console.fleets.ros2.messages import Planar, Stamped

MOST_FRAMES = 256
"""The largest number of frames kept for one robot; a robot with arms has about fifty."""


class Place(NamedTuple):
    """A place on the robot's map."""

    pose: Planar
    stamp: float
    """The time of the place, in seconds on the robot's clock."""
    arrived_s: float
    """The time of arrival, in seconds on the station's monotonic clock."""


class Localization:
    """The newest transform of each frame, and the place that results from the chain of them."""

    def __init__(self, map_frame: str, base_frame: str) -> None:
        self._map, self._base = map_frame, base_frame
        self._parents: dict[str, Stamped] = {}
        self.place: Place | None = None
        """The place of the robot; None while it is unknown."""

    def see_transforms(
        self, transforms: Iterable[Stamped], now_s: float, *, fixed: bool = False
    ) -> None:
        """Process transforms; a transform older than the last one of its frame is ignored.

        A `fixed` transform is valid at any time and does not determine the time of the place.
        """
        for transform in transforms:
            if fixed:
                transform = transform._replace(stamp=0.0)  # noqa: PLW2901
            before = self._parents.get(transform.child)
            if before is None and len(self._parents) >= MOST_FRAMES:
                continue
            if before is None or transform.stamp >= before.stamp:
                self._parents[transform.child] = transform
        if (chain := self._chain()) is not None:
            self.move(*chain, now_s)

    def move(self, pose: Planar, stamp: float, now_s: float) -> None:
        """Set the place of the robot, unless it is older than the current one."""
        if self.place is None or stamp > self.place.stamp:
            self.place = Place(pose, stamp, now_s)

    def _chain(self) -> tuple[Planar, float] | None:
        """Return the robot's pose on the map and its time; None while a transform is missing.

        The time is that of the first transform, counted from the robot, that is not fixed. The time
        of the map's transform is not used, because localization dates it in the future.
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
