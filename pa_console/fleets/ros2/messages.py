"""Plain values from the ROS 2 messages of a robot.

Whoever is in the robots' DDS domain can publish anything. A message with numbers that are not
finite, or that is of no use otherwise, raises UnreadableError. Nav2's result has grown from release
to release: nothing (Humble), an error code (Jazzy), a text as well (Kilted).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType
from typing import Any, NamedTuple

from pa_console.schema.text import visible_line

FARTHEST_M = 1e6
"""A coordinate beyond this is no place on any map, metres."""

MOST_ITEMS = 4096
"""A sequence in a message may be this long."""


class UnreadableError(ValueError):
    """A message that is not believed, with the reason."""


class GoalState(IntEnum):
    """The states of a goal, numbered as in `action_msgs/GoalStatus`."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @property
    def active(self) -> bool:
        """True while the robot works on the goal."""
        return GoalState.ACCEPTED <= self <= GoalState.CANCELING


REJECTED = 1
"""The answer to a request to cancel that changes nothing, as in `action_msgs/CancelGoal`."""


class Planar(NamedTuple):
    """A position in the plane of a map, metres, and a direction, radians from its x axis."""

    x: float
    y: float
    yaw: float

    def then(self, inner: "Planar") -> "Planar":
        """Return `inner`, which is given relative to this pose, in the frame of this pose."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return Planar(
            self.x + cosine * inner.x - sine * inner.y,
            self.y + sine * inner.x + cosine * inner.y,
            math.remainder(self.yaw + inner.yaw, math.tau),
        )


class Stamped(NamedTuple):
    """A pose of `child` in `parent` at `stamp`, seconds on the robot's clock."""

    parent: str
    child: str
    pose: Planar
    stamp: float


class Feedback(NamedTuple):
    """Progress towards a goal: metres to go, and the number of recoveries so far."""

    goal_id: bytes
    distance_m: float
    recoveries: int


@dataclass(frozen=True)
class GoalResult:
    """The end of a goal, with the robot's own reason for a failure; '' for none."""

    state: GoalState
    reason: str = ""


_REASONS: Mapping[int, str] = MappingProxyType(
    {
        100: "the controller failed",
        101: "the controller is not valid",
        102: "the controller does not know where the robot is",
        103: "the path is not valid",
        104: "its way was blocked for too long",
        105: "it made no progress",
        106: "no valid motion was found",
        107: "the controller timed out",
        200: "the planner failed",
        201: "the planner is not valid",
        202: "the planner does not know where the robot is",
        203: "it is outside its map",
        204: "the goal is outside its map",
        205: "its own place is marked as occupied",
        206: "the goal is occupied",
        207: "planning took too long",
        208: "there is no path to the goal",
        9000: "the navigator failed",
        9001: "it cannot load the behaviour tree",
        9002: "the navigator does not know where the robot is",
    }
)
"""Nav2's error codes of following a path, planning one, and navigating to a pose."""


def read_transforms(message: Any) -> tuple[Stamped, ...]:
    """Return the transforms of a `tf2_msgs/TFMessage`."""
    return tuple(
        Stamped(
            each.header.frame_id.lstrip("/"),
            each.child_frame_id.lstrip("/"),
            _planar(each.transform.translation, each.transform.rotation),
            _seconds(each.header.stamp),
        )
        for each in _few(message.transforms)
    )


def read_pose(message: Any) -> Stamped:
    """Return the pose of a `nav_msgs/Odometry` or `geometry_msgs/PoseWithCovarianceStamped`."""
    pose, frame = message.pose.pose, message.header.frame_id.lstrip("/")
    return Stamped(
        frame, "", _planar(pose.position, pose.orientation), _seconds(message.header.stamp)
    )


def read_speed(message: Any) -> float:
    """Return the speed in a `nav_msgs/Odometry`, metres a second."""
    linear = message.twist.twist.linear
    return math.hypot(_number(linear.x), _number(linear.y))


def read_battery(message: Any) -> float:
    """Return the charge of a `sensor_msgs/BatteryState`, percent."""
    share = _number(message.percentage)
    if not 0.0 <= share <= 1.0:
        raise UnreadableError(f"a charge of {share:g} is not from 0 to 1")
    return 100.0 * share


def read_goal_states(message: Any) -> dict[bytes, GoalState]:
    """Return the state of each goal in an `action_msgs/GoalStatusArray`, by its id."""
    return {
        bytes(each.goal_info.goal_id.uuid): _goal_state(each.status)
        for each in _few(message.status_list)
    }


def read_feedback(message: Any) -> Feedback:
    """Return the progress in a feedback message of `NavigateToPose`."""
    said = message.feedback
    distance, recoveries = _number(said.distance_remaining), int(said.number_of_recoveries)
    return Feedback(bytes(message.goal_id.uuid), max(distance, 0.0), max(recoveries, 0))


def read_result(message: Any) -> GoalResult:
    """Return the answer to a question for the result of a goal."""
    code = int(getattr(message.result, "error_code", 0))
    text = visible_line(getattr(message.result, "error_msg", "")[:200]).strip()
    named = f"{_REASONS.get(code, '')} (Nav2 error {code})".strip() if code else ""
    return GoalResult(_goal_state(message.status), ": ".join(p for p in (named, text) if p))


def _few(items: Any) -> Any:
    if len(items) > MOST_ITEMS:
        raise UnreadableError(f"it has {len(items)} items")
    return items


def _goal_state(number: int) -> GoalState:
    if number not in set(GoalState):
        raise UnreadableError(f"there is no goal state {number}")
    return GoalState(number)


def _planar(position: Any, turned: Any) -> Planar:
    x, y = _number(position.x), _number(position.y)
    if max(abs(x), abs(y)) > FARTHEST_M:
        raise UnreadableError(f"({x:g}, {y:g}) is no place on a map")
    qx, qy, qz, qw = (_number(value) for value in (turned.x, turned.y, turned.z, turned.w))
    if not 0.5 < qx * qx + qy * qy + qz * qz + qw * qw < 2.0:
        raise UnreadableError("its direction is no rotation")
    yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    return Planar(x, y, yaw)


def _seconds(stamp: Any) -> float:
    return int(stamp.sec) + int(stamp.nanosec) / 1_000_000_000


def _number(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise UnreadableError(f"a number in it is {number}")
    return number
