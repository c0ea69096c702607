"""A node in the robots' domain that publishes what no robot should, in the place of one of them."""

import math
from importlib import import_module
from random import Random
from typing import Any

rclpy: Any = import_module("rclpy")
geometry: Any = import_module("geometry_msgs.msg")
BatteryState: Any = import_module("sensor_msgs.msg").BatteryState
Odometry: Any = import_module("nav_msgs.msg").Odometry
TFMessage: Any = import_module("tf2_msgs.msg").TFMessage


class Intruder:
    """Publishes on the topics of one robot: numbers that are none, places far off, wrong frames."""

    def __init__(self, domain: int, namespace: str, seed: int) -> None:
        self._random, self._context = Random(seed), rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("intruder", namespace=namespace, context=self._context)
        publish = self._node.create_publisher
        self._tf, self._odom = publish(TFMessage, "tf", 10), publish(Odometry, "odom", 10)
        self._battery = publish(BatteryState, "battery_state", 10)

    def send(self) -> None:
        """Publish one message."""
        message = self._random.choice((self._transforms, self._odometry, self._charge))
        message()

    def close(self) -> None:
        """Leave the domain."""
        self._node.destroy_node()
        self._context.try_shutdown()

    def _number(self) -> float:
        return self._random.choice((math.nan, math.inf, -math.inf, 1e9, 1e300, -1e308))

    def _stamp(self) -> Any:
        ahead = rclpy.duration.Duration(seconds=self._random.choice((-1e6, 0.0, 60.0, 1e8)))
        return (self._node.get_clock().now() + ahead).to_msg()

    def _transforms(self) -> None:
        found = geometry.TransformStamped()
        found.header.stamp = self._stamp()
        if self._random.random() < 0.3:  # numbers that are well, in a frame that nobody knows
            found.header.frame_id, found.child_frame_id = "elsewhere", "base_footprint"
            found.transform.translation.x = 5.0
        else:
            found.header.frame_id, found.child_frame_id = "odom", "base_footprint"
            found.transform.translation.x = self._number()
            found.transform.rotation.w = self._random.choice((0.0, 1.0, math.nan))
        self._tf.publish(TFMessage(transforms=[found]))

    def _odometry(self) -> None:
        found = Odometry()
        found.header.stamp, found.header.frame_id = self._stamp(), "odom"
        found.pose.pose.position.x = self._number()
        found.twist.twist.linear.x = self._number()
        self._odom.publish(found)

    def _charge(self) -> None:
        self._battery.publish(BatteryState(percentage=self._random.choice((math.nan, -1.0, 9.0))))
