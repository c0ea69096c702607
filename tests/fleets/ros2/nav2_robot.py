"""`python -m tests.fleets.ros2.nav2_robot`: robots as Nav2 makes them, each an rclpy node.

They behave as Nav2's navigator does by its public source: a second goal takes the place of the
first unless its behaviour tree differs, and then it is aborted. Lines of JSON on standard input
change robots; each is answered by the state of all of them.
"""

import argparse
import json
import math
import sys
import threading
import time
from importlib import import_module
from typing import Any

rclpy: Any = import_module("rclpy")
actions: Any = import_module("rclpy.action")
qos: Any = import_module("rclpy.qos")
geometry: Any = import_module("geometry_msgs.msg")
BatteryState: Any = import_module("sensor_msgs.msg").BatteryState
NavigateToPose: Any = import_module("nav2_msgs.action").NavigateToPose
navigation: Any = import_module("nav_msgs.msg")
Odometry: Any = navigation.Odometry
GetState: Any = import_module("lifecycle_msgs.srv").GetState
TFMessage: Any = import_module("tf2_msgs.msg").TFMessage
KEPT = qos.QoSProfile(depth=1, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)


class Robot:
    """One robot, and the modes in which it misbehaves.

    `mode` is one of: "" (well), reject, abort, lie (succeeds where it stands), defiant (rejects
    every cancel), forgetful (takes a goal, and never ends it).
    """

    def __init__(self, context: Any, executor: Any, name: str, at: tuple[float, float]) -> None:
        self.x, self.y, self.yaw, self.speed = *at, 0.0, 0.0
        self.top_mps, self.charge, self.mode, self.runs_away = 4.0, 0.8, "", False
        self.silent = False
        """True while it publishes nothing; its action server goes on."""
        self.serves, self.lifecycle = True, 3
        """Whether its action server is there, and the state of `bt_navigator`, 3 when active."""
        self.goals: list[str] = []
        self.went_s: list[float] = []
        """When a goal came, on the machine's monotonic clock."""
        self.cancelled_s = self.stood_s = 0.0
        """When a request to cancel came, and when it stood after that."""
        self._running: Any = None
        self._ends: dict[bytes, Any] = {}
        self._target: tuple[float, float] | None = None
        self.node = rclpy.create_node("navigator", namespace=name, context=context)
        publish = self.node.create_publisher
        self._tf, self._odom = publish(TFMessage, "tf", 50), publish(Odometry, "odom", 10)
        self._battery = publish(BatteryState, "battery_state", 10)
        self._fixed = publish(TFMessage, "tf_static", KEPT)
        self._fixed.publish(TFMessage(transforms=[self._transform("base_footprint", "base_link")]))
        self._server: Any = None
        self._serve()
        self.node.create_service(GetState, "bt_navigator/get_state", self._answer_state)
        self.node.create_timer(0.05, self._step)
        executor.add_node(self.node)

    def _serve(self) -> None:
        """Begin to take goals, or end it."""
        if self._server is not None:
            self._server.destroy()
            self._server = None
            return
        self._server = actions.ActionServer(
            self.node,
            NavigateToPose,
            "navigate_to_pose",
            self._execute,
            goal_callback=self._goal,
            cancel_callback=self._cancel,
        )

    def _answer_state(self, _request: Any, answer: Any) -> Any:
        answer.current_state.id = self.lifecycle
        return answer

    def _goal(self, request: Any) -> Any:
        self.went_s.append(time.monotonic())
        return actions.GoalResponse.REJECT if self.mode == "reject" else actions.GoalResponse.ACCEPT

    def _cancel(self, _handle: Any) -> Any:
        self.cancelled_s = time.monotonic()
        defiant = self.mode == "defiant"
        return actions.CancelResponse.REJECT if defiant else actions.CancelResponse.ACCEPT

    async def _execute(self, handle: Any) -> Any:
        running, goal_id = self._running, bytes(handle.goal_id.uuid)
        if running is not None and running.request.behavior_tree != handle.request.behavior_tree:
            handle.abort()  # bt_navigator keeps the goal that it has
            return NavigateToPose.Result()
        if running is not None:
            self._end(running, 0, "preempted")
        self.goals.append(goal_id.hex())
        position = handle.request.pose.pose.position
        self._running, self._target = handle, (position.x, position.y)
        end = self._ends[goal_id] = rclpy.task.Future()
        code, text = await end
        if handle.is_cancel_requested:
            handle.canceled()
        elif text:
            handle.abort()
        else:
            handle.succeed()
        return NavigateToPose.Result(error_code=code, error_msg=text)

    def _end(self, handle: Any, code: int = 0, text: str = "") -> None:
        if handle is self._running:
            self._running = None
            self._target = self._target if self.runs_away else None
        self._ends.pop(bytes(handle.goal_id.uuid)).set_result((code, text))

    def _step(self) -> None:
        if self.serves is (self._server is None):
            self._serve()
        handle = self._running
        if handle is not None:
            if handle.is_cancel_requested:
                self._end(handle, 0, "cancelled")
            elif self.mode == "abort":
                self._end(handle, 208, "the corridor is closed")
            elif self.mode == "lie":
                self._end(handle)
        self._drive()
        if self._running is not None and self._target is None and self.mode != "forgetful":
            self._end(self._running)
        if not self.silent:
            self._publish()

    def _drive(self) -> None:
        self.speed = 0.0
        if self._target is not None:
            gap, step = math.dist((self.x, self.y), self._target), self.top_mps * 0.05
            if gap <= step:
                (self.x, self.y), self._target = self._target, None
            else:
                self.yaw = math.atan2(self._target[1] - self.y, self._target[0] - self.x)
                self.x, self.y = (
                    self.x + step * math.cos(self.yaw),
                    self.y + step * math.sin(self.yaw),
                )
                self.speed = self.top_mps
        if self.speed == 0.0 and self.stood_s < self.cancelled_s:
            self.stood_s = time.monotonic()

    def _transform(self, parent: str, child: str, *pose: float, ahead_s: float = 0.0) -> Any:
        found, (x, y, yaw) = geometry.TransformStamped(), pose or (0.0, 0.0, 0.0)
        found.header.frame_id, found.child_frame_id = parent, child
        found.header.stamp = self._now(ahead_s)
        found.transform.translation.x, found.transform.translation.y = x, y
        found.transform.rotation.z = math.sin(yaw / 2)
        found.transform.rotation.w = math.cos(yaw / 2)
        return found

    def _now(self, ahead_s: float = 0.0) -> Any:
        later = rclpy.duration.Duration(seconds=ahead_s)
        return (self.node.get_clock().now() + later).to_msg()

    def _publish(self) -> None:
        moved = self._transform("odom", "base_footprint", self.x, self.y, self.yaw)
        self._tf.publish(TFMessage(transforms=[self._transform("map", "odom", ahead_s=0.5)]))
        self._tf.publish(TFMessage(transforms=[moved]))
        odometry = Odometry(header=moved.header, child_frame_id="base_footprint")
        odometry.pose.pose.position.x, odometry.pose.pose.position.y = self.x, self.y
        odometry.pose.pose.orientation = moved.transform.rotation
        odometry.twist.twist.linear.x = self.speed
        self._odom.publish(odometry)
        self._battery.publish(BatteryState(percentage=self.charge))

    def state(self) -> dict[str, Any]:
        """Return what tests ask about."""
        names = ("goals", "went_s", "cancelled_s", "stood_s", "speed")
        return {"at": (self.x, self.y), **{name: getattr(self, name) for name in names}}


def publish_map(context: Any) -> Any:
    """Publish a map of 2 x 3 cells, of 1 m each, as `map_server` does; return its node."""
    node = rclpy.create_node("map_server", context=context)
    grid = navigation.OccupancyGrid(data=[100, 0, 0, -1, 0, 100])
    grid.header.frame_id, grid.info.resolution = "map", 1.0
    grid.info.width, grid.info.height = 2, 3
    grid.info.origin.position.x, grid.info.origin.orientation.w = 10.0, 1.0
    node.create_publisher(navigation.OccupancyGrid, "map", KEPT).publish(grid)
    return node


def serve(robots: dict[str, Robot]) -> None:
    """Answer the lines of standard input until it ends."""
    for line in sys.stdin:
        for name, changes in json.loads(line).items():
            for key, value in changes.items():
                setattr(robots[name], key, value)
        print(json.dumps({name: robot.state() for name, robot in robots.items()}), flush=True)


def main() -> None:
    """Run robots until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--domain", type=int)
    parser.add_argument("robots", type=json.loads)
    given = parser.parse_args()
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=given.domain)
    executor = import_module("rclpy.executors").SingleThreadedExecutor(context=context)
    robots = {name: Robot(context, executor, name, at) for name, at in given.robots.items()}
    executor.add_node(publish_map(context))
    print("ready", flush=True)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    serve(robots)
    executor.shutdown()
    thread.join()
    context.try_shutdown()


if __name__ == "__main__":
    main()
