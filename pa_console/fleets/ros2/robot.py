"""One robot as its topics show it: what it reports, and the states of its goals."""

import math
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Any

from pa_console.fleets.link import AssetReport, LinkNews, LinkNotice
from pa_console.fleets.ros2 import messages
from pa_console.fleets.ros2.connection import RobotSite
from pa_console.fleets.ros2.localization import Localization
from pa_console.fleets.ros2.messages import Stamped, UnreadableError
from pa_console.fleets.ros2.navigator import Navigator, Seen
from pa_console.schema.events.event import Level

if TYPE_CHECKING:
    from pa_console.fleets.ros2.node import Nav2Server, RosNode

AHEAD_S = 2.0
"""A time so far in the future is of a wrong clock; localization stamps up to a second ahead."""

BEHIND_S = 60.0
"""A time so long ago is of a wrong clock, or of a simulation's, seconds."""

QUIET_S = 10.0
"""The same notice of a robot is not repeated before this time, seconds."""


class Robot:
    """What is known of a robot; all on the thread of the node."""

    def __init__(
        self, name: str, site: RobotSite, server: "Nav2Server", tell: Callable[[LinkNews], None]
    ) -> None:
        self.name, self.server, self._site, self._tell = name, server, site, tell
        self._entry = entry = site.connection.robots[name]
        warn = partial(self._say, "warning")
        self.navigator = Navigator(name, entry, site, server, tell, warn, time.monotonic)
        self.localization = Localization(entry.map_frame, entry.base_frame)
        self._battery_pct = None if entry.battery is not None else 100.0
        self._speed_mps, self._speed_s = 0.0, -math.inf
        self._reported_stamp, self._servers = -math.inf, 0
        self._told: dict[str, float] = {}

    def listen(self, node: "RosNode") -> None:
        """Subscribe to its topics."""
        entry, tf = self._entry, "tf2_msgs/msg/TFMessage"
        pose = "geometry_msgs/msg/PoseWithCovarianceStamped"
        topics: list[tuple[str | None, str, Callable[[Any], None], bool]] = [
            (
                f"{entry.action}/_action/status",
                "action_msgs/msg/GoalStatusArray",
                self._states,
                True,
            ),
            (entry.battery, "sensor_msgs/msg/BatteryState", self._battery, False),
            (entry.manual, "std_msgs/msg/Bool", self._manual, False),
            (entry.odom, "nav_msgs/msg/Odometry", self._odometry, False),
        ]
        if entry.pose == "tf":
            topics.append((f"{entry.tf}_static", tf, partial(self._transforms, fixed=True), True))
            topics.append((entry.tf, tf, self._transforms, False))
        elif entry.pose == "amcl_pose":
            topics.append(("amcl_pose", pose, self._place, True))
        for topic, kind, take, kept in topics:
            if topic is not None:
                full = entry.named(self.name, topic)
                node.listen(full, kind, partial(self._take, full, take), kept=kept)

    def step(self) -> None:
        """Do what is due, and tell of an action server that has come, gone, or is not alone."""
        before, self._servers = self._servers, self.server.servers
        action = self.server.action
        if self._servers < before:  # the goals of a server that is gone are over
            self.navigator.see_states({})
        if self._servers > max(before, 1):
            text = f"{self._servers} action servers are called {action}: nothing but a hold is sent"
            self._say("alarm", text)
        elif self._servers == 0 < before:
            self._say("alarm", f"its action server {action} is gone")
        elif self._servers > before:
            self._say("info", f"its action server {action} is there")
        self.navigator.step()

    def _take(self, topic: str, take: Callable[[Any], None], message: Any) -> None:
        """Take in one message; one that is not believed is reported, and changes nothing."""
        try:
            take(message)
        except UnreadableError as error:
            self._say("alarm", f"a message on {topic} is set aside: {error}", topic)

    def _states(self, message: Any) -> None:
        self.navigator.see_states(messages.read_states(message))

    def _battery(self, message: Any) -> None:
        self._battery_pct = messages.read_battery(message)

    def _manual(self, message: Any) -> None:
        self.navigator.manual = bool(message.data)

    def _odometry(self, message: Any) -> None:
        pose, speed_mps = self._stamped(messages.read_pose(message)), messages.read_speed(message)
        self._speed_mps, self._speed_s = speed_mps, time.monotonic()
        if self._entry.pose == "odom":
            self._move(pose)

    def _transforms(self, message: Any, *, fixed: bool = False) -> None:
        found = messages.read_transforms(message)
        if not fixed:
            found = [self._stamped(each) for each in found]
        self.localization.see_transforms(found, time.monotonic(), fixed=fixed)
        self._report()

    def _place(self, message: Any) -> None:
        pose = self._stamped(messages.read_pose(message))
        if pose.parent != self._entry.map_frame:
            raise UnreadableError(f"it is in {pose.parent!r}, not in {self._entry.map_frame!r}")
        self._move(pose)

    def _move(self, pose: Stamped) -> None:
        self.localization.move(pose.pose, pose.stamp, time.monotonic())
        self._report()

    def _stamped(self, pose: Stamped) -> Stamped:
        """Return `pose` with the time that it counts as, seconds (UTC)."""
        now = time.time()
        if self._entry.clock == "arrival":
            return pose._replace(stamp=now)
        if pose.stamp - now > AHEAD_S:
            raise UnreadableError(f"its clock is {pose.stamp - now:.0f} s ahead of ours")
        if now - pose.stamp > BEHIND_S:
            text = "its clock is far behind ours; for simulated time set 'clock: arrival'"
            self._say("alarm", text)
        return pose

    def _report(self) -> None:
        """Report where the robot is, every telemetry period or so of its own time."""
        place = self.localization.place
        if place is None:
            return
        if self._speed_s == -math.inf:
            self._say("alarm", "is not shown without odometry: name its topic as 'odom'")
            return
        pose = self._site.fit.to_world(place.pose)
        arrived_s = min(place.arrived_s, self._speed_s)
        self.navigator.seen = Seen((pose.x, pose.y), self._speed_mps, arrived_s)
        # A report that is a little early is one of the next period; to wait would skip that.
        if place.stamp - self._reported_stamp < 0.9 * self._site.world.telemetry_period_s:
            return
        self._reported_stamp = place.stamp
        self._tell(
            AssetReport(
                agent=self.name,
                sent=datetime.fromtimestamp(round(place.stamp, 3), UTC),
                position=(pose.x, pose.y),
                heading_deg=math.degrees(pose.yaw) % 360.0,
                speed_mps=self._speed_mps,
                status="ok",
                task=self.navigator.task,
                battery_pct=self._battery_pct,
                command_id=self.navigator.command_id,
                manual=self.navigator.manual,
            )
        )
        self.navigator.reported(place.arrived_s)

    def _say(self, level: Level, text: str, about: str = "") -> None:
        """Give a notice; one about the same thing is given seldom."""
        now_s = time.monotonic()
        if now_s - self._told.get(about or text, -math.inf) >= QUIET_S:
            self._told[about or text] = now_s
            self._tell(LinkNotice(level, self.name, text))
