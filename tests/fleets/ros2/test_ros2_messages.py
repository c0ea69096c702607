"""ROS 2 messages: read and written as another encoder does, and nothing else raises."""

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets.ros2 import messages
from pa_console.fleets.ros2.messages import GoalResult, GoalState, Planar, UnreadableError
from tests.fleets.ros2 import wire
from tests.fleets.ros2.wire import Header, Pose, PoseStamped, Quaternion, Time, Uuid, Vector3

GOAL = bytes(range(16))
HEADER = Header(Time(12, 500_000_000), "/map")
POSE = Pose(Vector3(1.0, 2.0, 0.0), Quaternion.of(0.5))
WITH_COVARIANCE = wire.PoseWithCovariance(POSE)
INFO = wire.GoalInfo(Uuid(list(GOAL)), Time())
MOVED = wire.Transform(Vector3(1.0, 2.0, 0.0), Quaternion.of(0.5))
TWIST = wire.TwistWithCovariance(wire.Twist(Vector3(3.0, 4.0, 0.0), Vector3()))

WRITTEN: dict[str, tuple[Callable[[bytes], Any], bytes]] = {
    "tf": (
        messages.read_transforms,
        wire.TFMessage([wire.TransformStamped(HEADER, "odom", MOVED)]).serialize(),
    ),
    "odometry": (
        messages.read_odometry,
        wire.Odometry(HEADER, "base", WITH_COVARIANCE, TWIST).serialize(),
    ),
    "localization": (
        messages.read_localization,
        wire.PoseWithCovarianceStamped(HEADER, WITH_COVARIANCE).serialize(),
    ),
    "battery": (messages.read_battery, wire.BatteryState(HEADER, percentage=0.5).serialize()),
    "health": (messages.read_health, wire.DiagnosticStatus(1, message="low").serialize()),
    "flag": (messages.read_flag, wire.Bool(True).serialize()),
    "states": (
        messages.read_goal_states,
        wire.GoalStatusArray([wire.GoalStatus(INFO, 4)]).serialize(),
    ),
    "feedback": (
        messages.read_feedback,
        wire.FeedbackMessage(
            Uuid(list(GOAL)), PoseStamped(HEADER, POSE), wire.Duration(), wire.Duration(), 2, 7.5
        ).serialize(),
    ),
    "accepted": (messages.read_accepted, wire.SendGoalResponse(True, Time()).serialize()),
    "cancelled": (messages.read_cancelled, wire.CancelResponse(0, [INFO]).serialize()),
    "result": (messages.read_result, wire.ResultKilted(6, 208, "closed").serialize()),
}


def test_what_another_encoder_writes_is_read() -> None:
    read = {name: reader(payload) for name, (reader, payload) in WRITTEN.items()}
    (transform,) = read["tf"]
    assert (transform.parent, transform.child, transform.stamp) == ("map", "odom", 12.5)
    assert transform.pose == pytest.approx((1.0, 2.0, 0.5))
    assert read["odometry"][1] == 5.0
    assert read["localization"].pose == pytest.approx((1.0, 2.0, 0.5))
    assert read["battery"] == 50.0
    assert read["health"] == ("degraded", "low")
    assert read["flag"] is True
    assert read["states"] == {GOAL: GoalState.SUCCEEDED}
    assert read["feedback"] == (GOAL, 7.5, 2)
    assert read["accepted"] is True
    assert read["cancelled"] == messages.CancelCode.NONE


@pytest.mark.parametrize(
    ("payload", "result"),
    [
        (wire.ResultHumble(4).serialize(), GoalResult(GoalState.SUCCEEDED)),
        (wire.ResultHumble(6).serialize() + b"\0\0", GoalResult(GoalState.ABORTED)),
        (wire.ResultJazzy(4, 0).serialize(), GoalResult(GoalState.SUCCEEDED)),
        (
            wire.ResultJazzy(6, 206).serialize(),
            GoalResult(GoalState.ABORTED, "the goal is occupied (Nav2 error 206)"),
        ),
        (wire.ResultJazzy(6, 777).serialize(), GoalResult(GoalState.ABORTED, "(Nav2 error 777)")),
        (wire.ResultKilted(6, 0, "").serialize(), GoalResult(GoalState.ABORTED)),
        (
            wire.ResultKilted(6, 208, "the door\nis shut").serialize(),
            GoalResult(
                GoalState.ABORTED,
                r"there is no path to the goal (Nav2 error 208): the door\nis shut",
            ),
        ),
    ],
)
def test_the_result_of_every_release_is_read(payload: bytes, result: GoalResult) -> None:
    assert messages.read_result(payload) == result


def test_what_is_written_is_read_by_another_decoder() -> None:
    written = messages.write_goal(GOAL, Planar(1.0, 2.0, 0.5), "map", 1000.25, "identify.xml")
    goal = wire.SendGoalRequest.deserialize(written)
    assert bytes(goal.goal_id.uuid) == GOAL
    assert (goal.pose.header.frame_id, goal.behavior_tree) == ("map", "identify.xml")
    assert goal.pose.header.stamp == Time(1000, 250_000_000)
    assert goal.pose.pose.position == Vector3(1.0, 2.0, 0.0)
    turned = goal.pose.pose.orientation
    assert 2 * math.atan2(turned.z, turned.w) == pytest.approx(0.5)
    asked = wire.ResultRequest.deserialize(messages.write_result_request(GOAL))
    assert bytes(asked.goal_id.uuid) == GOAL
    one = wire.CancelRequest.deserialize(messages.write_cancel(GOAL)).goal_info
    assert bytes(one.goal_id.uuid) == GOAL
    every = wire.CancelRequest.deserialize(messages.write_cancel(None)).goal_info
    assert (bytes(every.goal_id.uuid), every.stamp) == (bytes(16), Time(0, 0))


@pytest.mark.parametrize("name", WRITTEN)
@settings(max_examples=40)
@given(data=st.data())
def test_whatever_comes_is_read_or_refused(name: str, data: st.DataObject) -> None:
    reader, payload = WRITTEN[name]
    sort = data.draw(st.sampled_from(("noise", "cut", "changed", "swapped")))
    if sort == "noise":
        payload = data.draw(st.binary(max_size=200))
    elif sort == "cut":
        payload = payload[: data.draw(st.integers(0, len(payload)))]
    elif sort == "swapped":
        payload = WRITTEN[data.draw(st.sampled_from(sorted(WRITTEN)))][1]
    else:
        changed = bytearray(payload)
        for _ in range(data.draw(st.integers(1, 8))):
            changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
        payload = bytes(changed)
    with suppress(UnreadableError):
        reader(payload)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e300])
def test_no_number_that_is_none_is_believed(number: float) -> None:
    pose = Pose(Vector3(number, 0.0, 0.0), Quaternion())
    payload = wire.PoseWithCovarianceStamped(HEADER, wire.PoseWithCovariance(pose)).serialize()
    with pytest.raises(UnreadableError):
        messages.read_localization(payload)
    turned = Pose(Vector3(), Quaternion(number, number, number, number))
    payload = wire.PoseWithCovarianceStamped(HEADER, wire.PoseWithCovariance(turned)).serialize()
    with pytest.raises(UnreadableError):
        messages.read_localization(payload)


def test_a_charge_that_is_not_measured_is_unknown() -> None:
    with pytest.raises(UnreadableError, match="nan"):
        messages.read_battery(wire.BatteryState(HEADER, percentage=math.nan).serialize())


def test_ros_itself_encodes_the_same_bytes() -> None:
    """The encoding of the ROS client library, where its wheels are installed."""
    reason = "needs the wheels ros-rclpy, ros-rmw-fastrtps-cpp, ros-tf2-msgs and ros-nav-msgs"
    serialization = pytest.importorskip("rclpy.serialization", reason=reason)
    geometry = pytest.importorskip("geometry_msgs.msg", reason=reason)
    action = pytest.importorskip("action_msgs.msg", reason=reason)
    pose = geometry.PoseWithCovarianceStamped()
    pose.header.frame_id, pose.pose.pose.position.x = "map", 3.5
    pose.pose.pose.orientation.w = 1.0
    found = messages.read_localization(bytes(serialization.serialize_message(pose)))
    assert (found.parent, found.pose.x) == ("map", 3.5)
    states = action.GoalStatusArray()
    state = action.GoalStatus()
    state.goal_info.goal_id.uuid, state.status = list(GOAL), 2
    states.status_list.append(state)
    read = messages.read_goal_states(bytes(serialization.serialize_message(states)))
    assert read == {GOAL: GoalState.EXECUTING}
    request = pytest.importorskip("action_msgs.srv", reason=reason).CancelGoal.Request()
    assert bytes(serialization.serialize_message(request)) == messages.write_cancel(None)
