"""A link to robots that navigate with Nav2: `--fleet ros2:FILE.yaml`.

The thread of the ROS 2 node does everything; the station's thread hands it commands and takes news.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from pa_console.fleets.link import AssetReport, DeviceAnswer, FoundRobot, LinkNews, LinkNotice
from pa_console.fleets.ros2 import messages
from pa_console.fleets.ros2.connection import RobotEntry, RobotSite, read_site
from pa_console.fleets.ros2.localization import Localization
from pa_console.fleets.ros2.messages import Stamped, UnreadableError
from pa_console.fleets.ros2.navigator import Navigator, Seen
from pa_console.schema.command import DeviceCommand
from pa_console.schema.document import DocumentError
from pa_console.schema.events.event import Level
from pa_console.schema.world import World
from pa_console.settings.schema import Settings

if TYPE_CHECKING:
    from pa_console.fleets.ros2.node import RosNode

PATIENCE_S = 10.0
"""The longest wait for a robot when a link is opened, seconds."""

AHEAD_S = 2.0
"""A time so far in the future is of a wrong clock; localization stamps up to a second ahead."""

BEHIND_S = 60.0
"""A time so long ago is of a wrong clock, or of a simulation's, seconds."""

CHARGE_S = 5.0
"""A robot that has not reported its charge within this time, seconds, does not report it."""

QUIET_S = 10.0
"""The same notice of a robot is not repeated before this time, seconds."""

MOST_NEWS = 20_000
"""The news that may wait to be taken; the oldest gives way."""


class _Robot:
    """One robot, what is known of it, and its topics; all on the node's thread."""

    def __init__(
        self,
        name: str,
        entry: RobotEntry,
        site: RobotSite,
        node: "RosNode",
        tell: Callable[[LinkNews], None],
    ) -> None:
        from pa_console.fleets.ros2.node import Nav2Server  # noqa: PLC0415 - where ROS 2 is

        self.name, self.entry, self._site, self._tell = name, entry, site, tell
        self.server = Nav2Server(node, name, entry)
        self.navigator = Navigator(
            name, entry, site, self.server, tell, partial(self._say, "warning"), time.monotonic
        )
        self.localization = Localization(entry.map_frame, entry.base_frame, entry.pose)
        self._battery_pct = None if entry.battery is not None else 100.0
        self._first_s, self._reported_stamp, self._servers = math.inf, -math.inf, 0
        self._told: dict[str, float] = {}
        pose = "geometry_msgs/msg/PoseWithCovarianceStamped"
        action = f"{self.server.action}/_action"
        wanted: list[tuple[str | None, str, Callable[[Any], None], bool]] = [
            (f"{action}/status", "action_msgs/msg/GoalStatusArray", self._states, True),
            (
                f"{action}/feedback",
                "nav2_msgs/action/NavigateToPose_FeedbackMessage",
                self._feedback,
                False,
            ),
            (entry.battery, "sensor_msgs/msg/BatteryState", self._battery, False),
            (entry.manual, "std_msgs/msg/Bool", self._manual, False),
            ("odom", "nav_msgs/msg/Odometry", self._odometry, False),
        ]
        if entry.pose == "tf":
            tf = "tf2_msgs/msg/TFMessage"
            wanted.append((f"{entry.tf}_static", tf, partial(self._transforms, fixed=True), True))
            wanted.append((entry.tf, tf, self._transforms, False))
        elif entry.pose == "amcl_pose":
            wanted.append(("amcl_pose", pose, self._amcl_pose, True))
        for topic, kind, take, kept in wanted:
            if topic is not None:
                full = entry.named(name, topic)
                node.listen(full, kind, partial(self._take, full, take), kept=kept)

    def step(self) -> None:
        """Do what is due."""
        servers = self.server.servers
        if servers != self._servers:
            self._count(servers)
        self.navigator.step()

    def _count(self, servers: int) -> None:
        """Tell that its action server has come or gone, or is not the only one."""
        before, self._servers = self._servers, servers
        if servers == 0:
            self._say("alarm", f"its action server {self.server.action} is gone")
        elif servers > 1:
            text = f"{servers} action servers are called {self.server.action}"
            self._say("alarm", f"{text}: it is only stopped until one is left")
        elif before == 0:
            self._say("info", f"its action server {self.server.action} is there")

    # Topics

    def _take(self, topic: str, take: Callable[[Any], None], message: Any) -> None:
        """Take in one message; one that is not believed is reported, and changes nothing."""
        try:
            take(message)
        except UnreadableError as error:
            self._say("alarm", f"a message on {topic} is set aside: {error}", topic)

    def _transforms(self, message: Any, *, fixed: bool = False) -> None:
        found = messages.read_transforms(message)
        if not fixed:
            found = [self._stamped(each) for each in found]
        self.localization.see_transforms(found, time.monotonic(), fixed=fixed)
        self._report()

    def _odometry(self, message: Any) -> None:
        pose, speed_mps = self._stamped(messages.read_pose(message)), messages.read_speed(message)
        self.localization.see_speed(speed_mps, pose.stamp, time.monotonic())
        if self.entry.pose == "odom":
            self._move(pose)

    def _amcl_pose(self, message: Any) -> None:
        pose = self._stamped(messages.read_pose(message))
        if pose.parent != self.entry.map_frame:
            raise UnreadableError(f"it is in {pose.parent!r}, not in {self.entry.map_frame!r}")
        self._move(pose)

    def _move(self, pose: Stamped) -> None:
        self.localization.move(pose.pose, pose.stamp, time.monotonic())
        self._report()

    def _battery(self, message: Any) -> None:
        self._battery_pct = messages.read_battery(message)

    def _manual(self, message: Any) -> None:
        self.navigator.manual = bool(message.data)

    def _states(self, message: Any) -> None:
        self.navigator.see_states(messages.read_goal_states(message))

    def _feedback(self, message: Any) -> None:
        self.navigator.see_feedback(messages.read_feedback(message))

    def _stamped(self, pose: Stamped) -> Stamped:
        """Return `pose` with the time that it counts as, seconds (UTC)."""
        now = time.time()
        if self.entry.clock == "arrival":
            return pose._replace(stamp=now)
        if pose.stamp - now > AHEAD_S:
            raise UnreadableError(f"its clock is {pose.stamp - now:.0f} s ahead of ours")
        if now - pose.stamp > BEHIND_S:
            text = "its clock is far behind ours; for simulated time set 'clock: arrival'"
            self._say("alarm", text)
        return pose

    # Reports

    def _report(self) -> None:
        """Report where the robot is, every telemetry period or so of its own time."""
        place, now_s = self.localization.place, time.monotonic()
        if place is None:
            return
        pose = self._site.fit.to_world(place.pose)
        speed_mps, arrived_s = self.localization.speed(place)
        self.navigator.see_place(Seen((pose.x, pose.y), pose.yaw, speed_mps, arrived_s))
        # A report that is a little early is one of the next period; to wait would skip that.
        if place.stamp - self._reported_stamp < 0.9 * self._site.world.telemetry_period_s:
            return
        if self._battery_pct is None:
            self._first_s = min(self._first_s, now_s)
            if now_s - self._first_s >= CHARGE_S:
                text = (
                    f"reports no charge on {self.entry.battery}, so it is not shown; "
                    "name its topic as 'battery', or 'battery: null' if it has no gauge"
                )
                self._say("alarm", text)
            return
        self._reported_stamp = place.stamp
        self._tell(
            AssetReport(
                agent=self.name,
                sent=datetime.fromtimestamp(round(place.stamp, 3), UTC),
                position=(pose.x, pose.y),
                heading_deg=math.degrees(pose.yaw) % 360.0,
                speed_mps=speed_mps,
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


class Ros2Link:
    """The robots of one file."""

    def __init__(self, path: Path, site: RobotSite) -> None:
        from pa_console.fleets.ros2.node import RosNode  # noqa: PLC0415 - where ROS 2 is

        self.name = f"ros2:{path}"
        self.agents = frozenset(site.connection.robots)
        self._site = site
        self._news: deque[LinkNews] = deque(maxlen=MOST_NEWS)
        self._arrived = Event()
        self._commands: deque[DeviceCommand] = deque()
        self._node = RosNode(site.connection.domain, self._fault)
        robots = site.connection.robots.items()
        self._robots = {n: _Robot(n, entry, site, self._node, self._tell) for n, entry in robots}
        self._node.start(self._step)

    @property
    def problem(self) -> str:
        """The reason why no robot can be commanded, '' while one can."""
        if any(self._node.servers.get(robot.server.action) for robot in self._robots.values()):
            return ""
        actions = ", ".join(robot.server.action for robot in self._robots.values())
        return f"no action server in ROS domain {self._node.domain} is called {actions}"

    def send(self, command: DeviceCommand) -> None:
        """Let the node's thread send `command` to its robot; returns at once."""
        self._commands.append(command)
        self._node.post(self._send)

    def take(self) -> Sequence[LinkNews]:
        """Return what came in since the last call."""
        self._arrived.clear()
        return [self._news.popleft() for _ in range(len(self._news))]

    def wait(self, seconds: float) -> bool:
        """Wait until there is news, for `seconds` at most; return whether there is."""
        return self._arrived.wait(seconds)

    def discover(self) -> Sequence[FoundRobot]:
        """Return a robot for each action server that takes goals in the domain."""
        named = {robot.server.action: robot for robot in self._robots.values()}
        found: list[FoundRobot] = []
        for action, count in sorted(self._node.servers.items()):
            robot = named.get(action)
            if not count:
                continue
            name = robot.name if robot is not None else action.rpartition("/")[0].strip("/")
            place = robot.localization.place if robot is not None else None
            at = self._site.fit.to_world(place.pose)[:2] if place is not None else None
            kind = self._site.world.assets[name].kind if robot is not None else "robot"
            found.append(FoundRobot(name.replace("/", "_"), kind, at, f"ROS 2, {action}"))
        return found

    def close(self) -> None:
        """End the node; the robots do what they do without a station."""
        self._node.close()

    def _send(self) -> None:
        """Send the commands that wait; no motion that waits goes out before a hold."""
        waiting = [self._commands.popleft() for _ in range(len(self._commands))]
        for place, command in enumerate(waiting):
            later = {each.agent for each in waiting[place + 1 :] if each.verb == "hold"}
            if command.verb != "hold" and command.agent in later:
                said = DeviceAnswer(command.command_id, command.agent, "refused", "a hold came")
                self._tell(said)
            elif (robot := self._robots.get(command.agent)) is not None:
                robot.navigator.send(command)

    def _step(self) -> None:
        for robot in self._robots.values():
            robot.step()

    def _tell(self, news: LinkNews) -> None:
        self._news.append(news)
        self._arrived.set()

    def _fault(self, error: Exception) -> None:
        text = f"a message is set aside: {type(error).__name__}: {error}"
        self._tell(LinkNotice("alarm", self.name, text))


def open_link(address: str, world: World, settings: Settings) -> Ros2Link:  # noqa: ARG001
    """Return the link to the robots of the file at `address`, for assets of `world`.

    Raises ValueError with the remedy for a file that cannot be used, if there is no ROS 2 here, and
    if none of the robots is there.
    """
    path = Path(address).expanduser()
    try:
        site = read_site(path, world)
        link = Ros2Link(path, site)
    except DocumentError as error:
        raise ValueError(str(error)) from error
    except ImportError as error:
        raise ValueError(
            f"--fleet ros2:{address}: ROS 2 cannot be loaded ({error}): run 'source "
            "/opt/ros/DISTRO/setup.bash' first, in a virtual environment that was made by "
            "'/usr/bin/python3 -m venv --system-site-packages' (see 'pa-console manual ros2')"
        ) from error
    until_s = time.monotonic() + PATIENCE_S
    while link.problem and time.monotonic() < until_s:
        link.wait(0.05)
    if problem := link.problem:
        link.close()
        raise ValueError(
            f"--fleet ros2:{address}: {problem}: start the robots, and check ROS_DOMAIN_ID, "
            "ROS_LOCALHOST_ONLY and their namespaces with 'ros2 action list'"
        )
    return link
