"""The ROS 2 messages of a robot, between their CDR encoding and plain values.

A payload that is not the expected message, or whose numbers are not finite, raises UnreadableError.
Nav2's `NavigateToPose` is written down here, because type stores hold common messages only. Its
result has grown from release to release: nothing (Humble), an error code (Jazzy), a text as well
(Kilted).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType
from typing import Any, NamedTuple, cast

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pa_console.schema.telemetry import AssetStatus
from pa_console.schema.text import visible_line

FARTHEST_M = 1e6
"""A coordinate beyond this is no place on any map, metres."""

MOST_ITEMS = 4096
"""A sequence in a message may be this long."""

GOAL_ID_BYTES = 16

_STORE = get_typestore(Stores.ROS2_JAZZY)
_STORE.max_sequence_length = MOST_ITEMS
_ACTION = "nav2_msgs/msg/NavigateToPose_"
_CANCEL = "action_msgs/msg/CancelGoal_"
_GOAL_ID = "unique_identifier_msgs/UUID goal_id\n"
_DEFINITIONS = {
    _ACTION + "SendGoal_Request": (
        _GOAL_ID + "geometry_msgs/PoseStamped pose\nstring behavior_tree"
    ),
    _ACTION + "SendGoal_Response": "bool accepted\nbuiltin_interfaces/Time stamp",
    _ACTION + "GetResult_Request": _GOAL_ID,
    _ACTION + "GetResult_Response": "int8 status\nuint16 error_code",
    _ACTION + "GetResult_Response_Text": "int8 status\nuint16 error_code\nstring error_msg",
    _ACTION + "FeedbackMessage": (
        _GOAL_ID + "geometry_msgs/PoseStamped current_pose\n"
        "builtin_interfaces/Duration navigation_time\n"
        "builtin_interfaces/Duration estimated_time_remaining\n"
        "int16 number_of_recoveries\nfloat32 distance_remaining"
    ),
    _CANCEL + "Request": "action_msgs/GoalInfo goal_info",
    _CANCEL + "Response": "int8 return_code\naction_msgs/GoalInfo[] goals_canceling",
}
for _name, _text in _DEFINITIONS.items():
    _STORE.register(get_types_from_msg(_text, _name))


class UnreadableError(ValueError):
    """A payload that is not the message it should be, with the reason."""


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


class CancelCode(IntEnum):
    """The answers to a request to cancel, numbered as in `action_msgs/CancelGoal`."""

    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL = 2
    GOAL_TERMINATED = 3


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

_HEALTH: tuple[AssetStatus, ...] = ("ok", "degraded", "failed", "failed")
"""The condition of an asset by the level of its diagnostics: OK, WARN, ERROR, STALE."""


def read_transforms(payload: bytes) -> tuple[Stamped, ...]:
    """Return the transforms of a `tf2_msgs/TFMessage`."""
    message = _read(payload, "tf2_msgs/msg/TFMessage")
    return tuple(
        Stamped(
            str(each.header.frame_id).lstrip("/"),
            str(each.child_frame_id).lstrip("/"),
            _planar(each.transform.translation, each.transform.rotation),
            _seconds(each.header.stamp),
        )
        for each in message.transforms
    )


def read_odometry(payload: bytes) -> tuple[Stamped, float]:
    """Return the pose of a `nav_msgs/Odometry`, and the speed in metres a second."""
    message = _read(payload, "nav_msgs/msg/Odometry")
    linear = message.twist.twist.linear
    speed = math.hypot(_number(linear.x), _number(linear.y))
    return _stamped(message, str(message.child_frame_id)), speed


def read_localization(payload: bytes) -> Stamped:
    """Return the pose of a `geometry_msgs/PoseWithCovarianceStamped`."""
    return _stamped(_read(payload, "geometry_msgs/msg/PoseWithCovarianceStamped"), "")


def read_battery(payload: bytes) -> float:
    """Return the charge of a `sensor_msgs/BatteryState`, percent."""
    share = _number(_read(payload, "sensor_msgs/msg/BatteryState").percentage)
    if not 0.0 <= share <= 1.0:
        raise UnreadableError(f"a charge of {share:g} is not from 0 to 1")
    return 100.0 * share


def read_health(payload: bytes) -> tuple[AssetStatus, str]:
    """Return the condition in a `diagnostic_msgs/DiagnosticStatus`, with its own words."""
    message = _read(payload, "diagnostic_msgs/msg/DiagnosticStatus")
    level = int(message.level)
    if not 0 <= level < len(_HEALTH):
        raise UnreadableError(f"there is no level {level} of diagnostics")
    return _HEALTH[level], _words(message.message)


def read_flag(payload: bytes) -> bool:
    """Return the value of a `std_msgs/Bool`."""
    return bool(_read(payload, "std_msgs/msg/Bool").data)


def read_goal_states(payload: bytes) -> dict[bytes, GoalState]:
    """Return the state of each goal in an `action_msgs/GoalStatusArray`, by its id."""
    message = _read(payload, "action_msgs/msg/GoalStatusArray")
    return {
        _goal_id(each.goal_info.goal_id): _goal_state(each.status) for each in message.status_list
    }


def read_feedback(payload: bytes) -> Feedback:
    """Return the progress in a feedback message of `NavigateToPose`."""
    message = _read(payload, _ACTION + "FeedbackMessage")
    distance, recoveries = _number(message.distance_remaining), int(message.number_of_recoveries)
    return Feedback(_goal_id(message.goal_id), max(distance, 0.0), max(recoveries, 0))


def read_accepted(payload: bytes) -> bool:
    """Return whether the answer to a new goal accepts it."""
    return bool(_read(payload, _ACTION + "SendGoal_Response").accepted)


def read_cancelled(payload: bytes) -> CancelCode:
    """Return the answer to a request to cancel."""
    code = int(_read(payload, _CANCEL + "Response").return_code)
    if code not in set(CancelCode):
        raise UnreadableError(f"there is no return code {code}")
    return CancelCode(code)


def read_result(payload: bytes) -> GoalResult:
    """Return the answer to a question for the result of a goal.

    The length reveals the release of Nav2: the encoding of Humble's empty result takes at most one
    word of four bytes, and a text makes it longer than two.
    """
    body = len(payload) - 4
    if body < 1:
        raise UnreadableError("the result of a goal is empty")
    if body < 4:
        return GoalResult(_goal_state(int.from_bytes(payload[4:5], signed=True)))
    name = "GetResult_Response_Text" if body > 8 else "GetResult_Response"
    message = _read(payload, _ACTION + name)
    state, code = _goal_state(message.status), int(message.error_code)
    text = _words(getattr(message, "error_msg", ""))
    known = _REASONS.get(code, "")
    named = f"{known} (Nav2 error {code})".strip() if code else ""
    return GoalResult(state, ": ".join(part for part in (named, text) if part))


def write_goal(goal_id: bytes, at: Planar, frame: str, sent: float, tree: str) -> bytes:
    """Return the request to go to `at`, a pose in the robot's `frame`, by a behaviour tree.

    `tree` is a file on the robot, '' for the robot's own choice; `sent` is in seconds (UTC).
    """
    make = _make
    header = make("std_msgs/msg/Header", stamp=_time(sent), frame_id=frame)
    position = make("geometry_msgs/msg/Point", x=at.x, y=at.y, z=0.0)
    half = at.yaw / 2
    turned = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
    pose = make("geometry_msgs/msg/Pose", position=position, orientation=turned)
    stamped = make("geometry_msgs/msg/PoseStamped", header=header, pose=pose)
    return _write(
        _ACTION + "SendGoal_Request", goal_id=_uuid(goal_id), pose=stamped, behavior_tree=tree
    )


def write_result_request(goal_id: bytes) -> bytes:
    """Return the question for the result of a goal."""
    return _write(_ACTION + "GetResult_Request", goal_id=_uuid(goal_id))


def write_cancel(goal_id: bytes | None) -> bytes:
    """Return the request to cancel a goal; None cancels all goals of the robot."""
    which = _uuid(goal_id or bytes(GOAL_ID_BYTES))
    info = _make("action_msgs/msg/GoalInfo", goal_id=which, stamp=_time(0.0))
    return _write(_CANCEL + "Request", goal_info=info)


def _make(name: str, **fields: object) -> object:
    return cast(Any, _STORE.types[name])(**fields)


def _write(name: str, **fields: object) -> bytes:
    return bytes(_STORE.serialize_cdr(_make(name, **fields), name, little_endian=True))


def _read(payload: bytes, name: str) -> Any:
    """Return the message in `payload`."""
    try:
        return cast(Any, _STORE.deserialize_cdr(payload, name))
    except (SerdeError, ValueError, IndexError, TypeError, OverflowError, MemoryError) as error:
        raise UnreadableError(f"no {name.replace('/msg/', '/')}: {error}") from error


def _uuid(goal_id: bytes) -> object:
    return _make("unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(goal_id, dtype=np.uint8))


def _time(seconds: float) -> object:
    whole = int(seconds)
    return _make(
        "builtin_interfaces/msg/Time", sec=whole, nanosec=int((seconds - whole) * 1_000_000_000)
    )


def _goal_id(message: Any) -> bytes:
    return bytes(message.uuid)


def _goal_state(number: int) -> GoalState:
    if number not in set(GoalState):
        raise UnreadableError(f"there is no goal state {number}")
    return GoalState(number)


def _stamped(message: Any, child: str) -> Stamped:
    pose = message.pose.pose
    return Stamped(
        str(message.header.frame_id).lstrip("/"),
        child.lstrip("/"),
        _planar(pose.position, pose.orientation),
        _seconds(message.header.stamp),
    )


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


def _words(text: object) -> str:
    """Return a robot's own words, short enough for a line of the log."""
    return visible_line(str(text)[:200]).strip()
