"""Readers of the ROS 2 messages of a robot, which return plain values.

Anyone in the robots' DDS domain can publish. Therefore, the readers raise UnreadableError for
numbers that are not finite and for other invalid content. The result of Nav2 depends on the
release: it is empty (Humble), has an error code (Jazzy), or also has a text (Kilted).
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from pa_console.schema.text import visible_line

FARTHEST_M = 1e6
"""The largest accepted coordinate, in metres."""

MOST_ITEMS = 4096
"""The largest accepted length of a sequence in a message."""

MOST_CELLS = 4_000_000
"""The largest accepted number of cells of a map, enough for 100 m by 100 m at 5 cm."""

CELL_M = (0.005, 10.0)
"""The smallest and the largest accepted cell of a map, in metres."""

OCCUPIED, FREE = 65, 25
"""The least value of an occupied cell, and the largest value of a free one, in percent."""

UNKNOWN, SUCCEEDED, CANCELED = 0, 4, 5
ACTIVE = range(1, 4)
"""The states of a goal, numbered as in `action_msgs/GoalStatus`."""

ACTIVE_STATE = "active"
_STATES = MappingProxyType({1: "unconfigured", 2: "inactive", 3: ACTIVE_STATE, 4: "finalized"})


class UnreadableError(ValueError):
    """Raised with the reason if a message is not valid."""


class Planar(NamedTuple):
    """A pose in the plane of a map: metres, and radians from the x axis."""

    x: float
    y: float
    yaw: float

    def then(self, inner: "Planar") -> "Planar":
        """Convert `inner`, a pose relative to this one, to the frame in which this one is given."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return Planar(
            self.x + cosine * inner.x - sine * inner.y,
            self.y + sine * inner.x + cosine * inner.y,
            math.remainder(self.yaw + inner.yaw, math.tau),
        )


class Grid(NamedTuple):
    """A map with its occupied and its free cells; the first row is at the top.

    `corner` is the pose of the lower left corner.
    """

    frame: str
    corner: Planar
    cell_m: float
    occupied: npt.NDArray[np.bool_]
    free: npt.NDArray[np.bool_]


class Stamped(NamedTuple):
    """A pose of `child` in `parent` at the time `stamp`, in seconds on the robot's clock."""

    parent: str
    child: str
    pose: Planar
    stamp: float


_REASONS: Mapping[int, str] = MappingProxyType(
    {
        102: "the controller does not know where the robot is",
        104: "its way was blocked for too long",
        105: "it made no progress",
        202: "the planner does not know where the robot is",
        203: "it is outside its map",
        204: "the goal is outside its map",
        205: "its own place is marked as occupied",
        206: "the goal is occupied",
        208: "there is no path to the goal",
        9001: "it cannot load the behaviour tree",
    }
)
"""The reasons for those error codes of Nav2 to which an operator can react."""


def read_transforms(message: Any) -> list[Stamped]:
    """Return the transforms of a `tf2_msgs/TFMessage`."""
    return [
        Stamped(
            transform.header.frame_id.lstrip("/"),
            transform.child_frame_id.lstrip("/"),
            _planar(transform.transform.translation, transform.transform.rotation),
            _seconds(transform.header.stamp),
        )
        for transform in _few(message.transforms)
    ]


def read_pose(message: Any) -> Stamped:
    """Return the pose of a `nav_msgs/Odometry` or `geometry_msgs/PoseWithCovarianceStamped`."""
    pose = _planar(message.pose.pose.position, message.pose.pose.orientation)
    return Stamped(message.header.frame_id.lstrip("/"), "", pose, _seconds(message.header.stamp))


def read_speed(message: Any) -> float:
    """Return the speed in a `nav_msgs/Odometry`, in metres per second."""
    linear = message.twist.twist.linear
    return math.hypot(_number(linear.x), _number(linear.y))


def read_battery(message: Any) -> float:
    """Return the charge in a `sensor_msgs/BatteryState`, in percent."""
    share = _number(message.percentage)
    if not 0.0 <= share <= 1.0:
        raise UnreadableError(f"a charge of {share:g} is not from 0 to 1")
    return 100.0 * share


def read_states(message: Any) -> dict[bytes, int]:
    """Return the state of each goal in an `action_msgs/GoalStatusArray`, by its id."""
    return {bytes(goal.goal_info.goal_id.uuid): goal.status for goal in _few(message.status_list)}


def read_result(message: Any) -> tuple[int, str]:
    """Return the state of a goal, and the robot's reason for a failure; '' if it gives none."""
    code = int(getattr(message.result, "error_code", 0))
    text = visible_line(getattr(message.result, "error_msg", "")[:200]).strip()
    named = f"{_REASONS.get(code, '')} (Nav2 error {code})".strip() if code else ""
    return message.status, ": ".join(part for part in (named, text) if part)


def read_state(message: Any) -> str:
    """Return the name of the state in the answer of a managed node."""
    return _STATES.get(message.current_state.id, "changing its state")


def read_grid(message: Any) -> Grid:
    """Return the map in a `nav_msgs/OccupancyGrid`; cells outside 0 to 100 % are unknown."""
    info = message.info
    width, height, cell_m = int(info.width), int(info.height), _number(info.resolution)
    if not 0 < width * height <= MOST_CELLS:
        raise UnreadableError(f"{width} x {height} cells are not read, but at most {MOST_CELLS}")
    if len(message.data) != width * height:
        raise UnreadableError(f"it has {len(message.data)} of {width * height} cells")
    if not CELL_M[0] <= cell_m <= CELL_M[1]:
        raise UnreadableError(f"a cell of {cell_m:g} m is not a cell of a map")
    corner = _planar(info.origin.position, info.origin.orientation)
    cells = np.asarray(message.data, np.int8).reshape(height, width)[::-1]
    occupied, free = (cells >= OCCUPIED) & (cells <= 100), (cells >= 0) & (cells <= FREE)
    return Grid(message.header.frame_id.lstrip("/"), corner, cell_m, occupied, free)


def _number(value: float) -> float:
    """Return `value`; raises UnreadableError if it is not finite."""
    if not math.isfinite(value):
        raise UnreadableError(f"it contains the number {value}")
    return value


def _few(items: Any) -> Any:
    if len(items) > MOST_ITEMS:
        raise UnreadableError(f"it has {len(items)} items")
    return items


def _planar(position: Any, turned: Any) -> Planar:
    x, y = _number(position.x), _number(position.y)
    if max(abs(x), abs(y)) > FARTHEST_M:
        raise UnreadableError(f"({x:g}, {y:g}) is not a place on a map")
    qx, qy, qz, qw = (_number(value) for value in (turned.x, turned.y, turned.z, turned.w))
    if not 0.5 < qx * qx + qy * qy + qz * qz + qw * qw < 2.0:
        raise UnreadableError("its direction is not a rotation")
    yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    return Planar(x, y, yaw)


def _seconds(stamp: Any) -> float:
    return stamp.sec + stamp.nanosec / 1_000_000_000
