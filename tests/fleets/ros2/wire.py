"""The ROS 2 messages of a Nav2 robot, for the counterpart in the tests: encoded by pycdr2.

Written from the public definitions (common_interfaces, rcl_interfaces, navigation2). It shares no
code with the console, which encodes by rosbags.
"""

import math
from dataclasses import dataclass, field
from hashlib import sha256
from typing import TYPE_CHECKING, TypeAlias

from pycdr2 import IdlStruct
from pycdr2.types import array, float32, float64, int8, int16, int32, uint8, uint16, uint32

if TYPE_CHECKING:  # to a type checker, a sequence of ROS is a list
    sequence = list
    Bytes16: TypeAlias = list[int]
    Covariance: TypeAlias = list[float]
else:
    from pycdr2.types import sequence

    Bytes16, Covariance = array[uint8, 16], array[float64, 36]


@dataclass
class Time(IdlStruct, typename="Time"):
    """`builtin_interfaces/Time`."""

    sec: int32 = 0
    nanosec: uint32 = 0

    @classmethod
    def of(cls, seconds: float) -> "Time":
        """Return a time, seconds (UTC)."""
        whole = math.floor(seconds)
        return cls(whole, int((seconds - whole) * 1e9))


@dataclass
class Header(IdlStruct, typename="Header"):
    """`std_msgs/Header`."""

    stamp: Time
    frame_id: str = ""


@dataclass
class Vector3(IdlStruct, typename="Vector3"):
    """`geometry_msgs/Vector3, and Point`."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename="Quaternion"):
    """`geometry_msgs/Quaternion`."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0

    @classmethod
    def of(cls, yaw: float) -> "Quaternion":
        """Return a turn about the vertical, radians."""
        return cls(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


@dataclass
class Pose(IdlStruct, typename="Pose"):
    """`geometry_msgs/Pose`."""

    position: Vector3
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct, typename="PoseStamped"):
    """`geometry_msgs/PoseStamped`."""

    header: Header
    pose: Pose


@dataclass
class Transform(IdlStruct, typename="Transform"):
    """`geometry_msgs/Transform`."""

    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="TransformStamped"):
    """`geometry_msgs/TransformStamped`."""

    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="TFMessage"):
    """`tf2_msgs/TFMessage`."""

    transforms: sequence[TransformStamped]


@dataclass
class PoseWithCovariance(IdlStruct, typename="PoseWithCovariance"):
    """`geometry_msgs/PoseWithCovariance`."""

    pose: Pose
    covariance: Covariance = field(default_factory=lambda: [0.0] * 36)


@dataclass
class PoseWithCovarianceStamped(IdlStruct, typename="PoseWithCovarianceStamped"):
    """`geometry_msgs/PoseWithCovarianceStamped`."""

    header: Header
    pose: PoseWithCovariance


@dataclass
class Twist(IdlStruct, typename="Twist"):
    """`geometry_msgs/Twist`."""

    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct, typename="TwistWithCovariance"):
    """`geometry_msgs/TwistWithCovariance`."""

    twist: Twist
    covariance: Covariance = field(default_factory=lambda: [0.0] * 36)


@dataclass
class Odometry(IdlStruct, typename="Odometry"):
    """`nav_msgs/Odometry`."""

    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class BatteryState(IdlStruct, typename="BatteryState"):
    """`sensor_msgs/BatteryState`."""

    header: Header
    voltage: float32 = 24.0
    temperature: float32 = math.nan
    current: float32 = math.nan
    charge: float32 = math.nan
    capacity: float32 = math.nan
    design_capacity: float32 = math.nan
    percentage: float32 = 1.0
    power_supply_status: uint8 = 2
    power_supply_health: uint8 = 1
    power_supply_technology: uint8 = 2
    present: bool = True
    cell_voltage: sequence[float32] = field(default_factory=list[float])
    cell_temperature: sequence[float32] = field(default_factory=list[float])
    location: str = ""
    serial_number: str = ""


@dataclass
class KeyValue(IdlStruct, typename="KeyValue"):
    """`diagnostic_msgs/KeyValue`."""

    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="DiagnosticStatus"):
    """`diagnostic_msgs/DiagnosticStatus`."""

    level: uint8
    name: str = "toplevel_state"
    message: str = ""
    hardware_id: str = ""
    values: sequence[KeyValue] = field(default_factory=list[KeyValue])


@dataclass
class Bool(IdlStruct, typename="Bool"):
    """`std_msgs/Bool`."""

    data: bool


@dataclass
class Uuid(IdlStruct, typename="Uuid"):
    """`unique_identifier_msgs/UUID`."""

    uuid: Bytes16


@dataclass
class GoalInfo(IdlStruct, typename="GoalInfo"):
    """`action_msgs/GoalInfo`."""

    goal_id: Uuid
    stamp: Time


@dataclass
class GoalStatus(IdlStruct, typename="GoalStatus"):
    """`action_msgs/GoalStatus`."""

    goal_info: GoalInfo
    status: int8


@dataclass
class GoalStatusArray(IdlStruct, typename="GoalStatusArray"):
    """`action_msgs/GoalStatusArray`."""

    status_list: sequence[GoalStatus]


@dataclass
class SendGoalRequest(IdlStruct, typename="SendGoalRequest"):
    """`nav2_msgs/NavigateToPose_SendGoal, request`."""

    goal_id: Uuid
    pose: PoseStamped
    behavior_tree: str


@dataclass
class SendGoalResponse(IdlStruct, typename="SendGoalResponse"):
    """`nav2_msgs/NavigateToPose_SendGoal, response`."""

    accepted: bool
    stamp: Time


@dataclass
class CancelRequest(IdlStruct, typename="CancelRequest"):
    """`action_msgs/CancelGoal, request`."""

    goal_info: GoalInfo


@dataclass
class CancelResponse(IdlStruct, typename="CancelResponse"):
    """`action_msgs/CancelGoal, response`."""

    return_code: int8
    goals_canceling: sequence[GoalInfo]


@dataclass
class ResultRequest(IdlStruct, typename="ResultRequest"):
    """`nav2_msgs/NavigateToPose_GetResult, request`."""

    goal_id: Uuid


@dataclass
class ResultHumble(IdlStruct, typename="ResultHumble"):
    """The result is a `std_msgs/Empty`, which ROS gives one member of a byte."""

    status: int8
    structure_needs_at_least_one_member: uint8 = 0


@dataclass
class ResultJazzy(IdlStruct, typename="ResultJazzy"):
    """`nav2_msgs/NavigateToPose_GetResult, response of Jazzy`."""

    status: int8
    error_code: uint16 = 0


@dataclass
class ResultKilted(IdlStruct, typename="ResultKilted"):
    """`nav2_msgs/NavigateToPose_GetResult, response of Kilted`."""

    status: int8
    error_code: uint16 = 0
    error_msg: str = ""


@dataclass
class Duration(IdlStruct, typename="Duration"):
    """`builtin_interfaces/Duration`."""

    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class FeedbackMessage(IdlStruct, typename="FeedbackMessage"):
    """`nav2_msgs/NavigateToPose_FeedbackMessage`."""

    goal_id: Uuid
    current_pose: PoseStamped
    navigation_time: Duration
    estimated_time_remaining: Duration
    number_of_recoveries: int16
    distance_remaining: float32


TYPES: dict[str, str] = {
    "tf": "tf2_msgs::msg::dds_::TFMessage_",
    "tf_static": "tf2_msgs::msg::dds_::TFMessage_",
    "odom": "nav_msgs::msg::dds_::Odometry_",
    "amcl_pose": "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_",
    "battery_state": "sensor_msgs::msg::dds_::BatteryState_",
    "diagnostics_toplevel_state": "diagnostic_msgs::msg::dds_::DiagnosticStatus_",
    "joystick": "std_msgs::msg::dds_::Bool_",
    "navigate_to_pose/_action/status": "action_msgs::msg::dds_::GoalStatusArray_",
    "navigate_to_pose/_action/feedback": (
        "nav2_msgs::action::dds_::NavigateToPose_FeedbackMessage_"
    ),
    "navigate_to_pose/_action/send_goal": "nav2_msgs::action::dds_::NavigateToPose_SendGoal_",
    "navigate_to_pose/_action/cancel_goal": "action_msgs::srv::dds_::CancelGoal_",
    "navigate_to_pose/_action/get_result": "nav2_msgs::action::dds_::NavigateToPose_GetResult_",
}
"""The types on rmw_zenoh, by name."""


def type_hash(name: str) -> str:
    """Return a type hash of the right form; a client must not know it before the token comes."""
    return f"RIHS01_{sha256(name.encode()).hexdigest()}"
