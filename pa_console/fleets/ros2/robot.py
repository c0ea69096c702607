"""One robot according to its topics: its reports, the states of its goals, and its readiness."""

import math
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Any

from pa_console.fleets.link import AssetReport, LinkFinding, LinkNews, LinkNotice
from pa_console.fleets.readiness import MessageWatch, NeededMessage, Readiness, readiness_finding
from pa_console.fleets.ros2 import messages
from pa_console.fleets.ros2.connection import RobotEntry, RobotSite
from pa_console.fleets.ros2.localization import Localization
from pa_console.fleets.ros2.messages import ACTIVE_STATE, Stamped, UnreadableError
from pa_console.fleets.ros2.navigator import Navigator, Seen
from pa_console.schema.events.event import Level
from pa_console.schema.text import count

if TYPE_CHECKING:
    from pa_console.fleets.ros2.node import ManagedNode, Nav2Server, RosNode

AHEAD_S = 2.0
"""The largest accepted time in the future, in seconds; localization stamps up to a second ahead."""

BEHIND_S = 60.0
"""The age of a message, in seconds, from which the clock is reported as wrong or simulated."""

QUIET_S = 10.0
"""The least time between two equal notices about a robot, in seconds."""

SILENT_S = 5.0
"""The time without a position after which a robot is not ready, in seconds."""

LOOK_S = 0.5
"""The interval between checks of readiness, in seconds; a query of the ROS graph takes time."""

ASK_S = 2.0
"""The interval between requests for the state of a managed node, in seconds."""

GONE = "gone"
TF, ODOMETRY = "tf2_msgs/msg/TFMessage", "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"


def needed_messages(name: str, entry: RobotEntry) -> tuple[NeededMessage, ...]:
    """Return the messages that the console needs from the robot with the asset's `name`."""
    where, full = "its place is unknown, and it is not shown", partial(entry.named, name)
    place = {
        "tf": (
            NeededMessage(
                full(entry.tf), 1.0, where, 0, SILENT_S, "the base, and AMCL or SLAM ('tf')"
            ),
        ),
        "amcl_pose": (NeededMessage(full("amcl_pose"), 0.0, where, 0, SILENT_S, "AMCL"),),
        "odom": (),
    }
    speed = "its speed is unknown, and it is not shown"
    charge = "its battery counts as low"
    gauge = () if entry.battery is None else (
        NeededMessage(
            full(entry.battery), 1.0, charge, source="its driver, or set 'battery: null'"
        ),
    )  # fmt: skip
    odometry = NeededMessage(full(entry.odom), 1.0, speed, 0, SILENT_S, "the base ('odom')")
    return (*place[entry.pose], odometry, *gauge)


class Robot:
    """The state of one robot; all members are called on the thread of the node."""

    def __init__(
        self, name: str, site: RobotSite, server: "Nav2Server", tell: Callable[[LinkNews], None]
    ) -> None:
        self.name, self.server, self._site, self._tell = name, server, site, tell
        self._entry = entry = site.connection.robots[name]
        warn = partial(self._say, "warning")
        self.navigator = Navigator(name, entry, site, server, tell, warn, time.monotonic)
        self.localization = Localization(entry.map_frame, entry.base_frame)
        self.readiness = Readiness(name, tell)
        self._watch = MessageWatch(needed_messages(name, entry), time.monotonic())
        self._managed: dict[str, ManagedNode] = {}
        self._states: dict[str, str] = {}
        """The states of the managed nodes that have answered."""
        self._look_s = self._ask_s = 0.0
        self._battery_pct = None if entry.battery is not None else 100.0
        self._speed_mps, self._speed_s = 0.0, -math.inf
        self._reported_stamp, self._servers = -math.inf, 0
        self._told: dict[str, float] = {}

    def listen(self, node: "RosNode", managed: "Callable[[RosNode, str], ManagedNode]") -> None:
        """Subscribe to the robot's topics; `managed` returns a managed node by its full name."""
        entry = self._entry
        self._managed = {name: managed(node, entry.named(self.name, name)) for name in entry.nodes}
        status, states = f"{entry.action}/_action/status", "action_msgs/msg/GoalStatusArray"
        topics: list[tuple[str | None, str, Callable[[Any], None], bool]] = [
            (status, states, self._goals, True),
            (entry.battery, "sensor_msgs/msg/BatteryState", self._battery, False),
            (entry.manual, "std_msgs/msg/Bool", self._manual, False),
            (entry.odom, ODOMETRY, self._odometry, False),
        ]
        if entry.pose == "tf":
            topics.append((f"{entry.tf}_static", TF, partial(self._transforms, fixed=True), True))
            topics.append((entry.tf, TF, self._transforms, False))
        elif entry.pose == "amcl_pose":
            topics.append(("amcl_pose", POSE, self._place, True))
        for topic, kind, take, kept in topics:
            if topic is not None:
                full = entry.named(self.name, topic)
                node.listen(full, kind, partial(self._take, full, take), kept=kept)

    def step(self) -> None:
        """Check the readiness, request the states of managed nodes, and step the navigator."""
        now_s = time.monotonic()
        if now_s >= self._look_s:
            self._look_s = now_s + LOOK_S
            self._count_servers()
            self.readiness.note(self._lacks(now_s))
            self.navigator.not_ready = self.readiness.why
        if now_s >= self._ask_s:
            self._ask_s = now_s + ASK_S
            for name, managed in self._managed.items():
                managed.ask(partial(self._see_state, name))
        self.navigator.step()

    def _count_servers(self) -> None:
        """Report an action server that has appeared or disappeared, and duplicate servers."""
        before, self._servers = self._servers, self.server.servers
        action = self.server.action
        if self._servers < before:  # the goals of a server end with it
            self.navigator.see_states({})
        if self._servers > max(before, 1):
            text = f"{self._servers} action servers are called {action}: only holds are sent"
            self._say("alarm", text)
        elif self._servers == 0 < before:
            self._say("alarm", f"its action server {action} is gone")
        elif self._servers > before:
            self._say("info", f"its action server {action} has appeared")

    def _see_state(self, name: str, state: str | None) -> None:
        """Store the state of a managed node; a robot without the node never answers."""
        if state is not None or name in self._states:
            self._states[name] = state or GONE

    def _lacks(self, now_s: float) -> Iterator[str]:
        """Yield the reasons why the robot cannot start.

        A robot without any sign of life yields none, because it counts as lost, not as unready.
        """
        watch, since_s = self._watch, now_s - SILENT_S
        if watch.began_s > since_s or not self._is_heard(since_s):
            return
        missing = [need.name for need in watch.missing(now_s) if need.patience_s == SILENT_S]
        if not self._servers:
            yield f"there is no action server {self.server.action}"
        yield from (f"no messages arrive on {topic}" for topic in missing)
        if self._entry.pose == "tf" and not (missing or self._is_placed(since_s)):
            yield f"no transform leads from {self._entry.map_frame} to {self._entry.base_frame}"
        yield from (f"{node} is {s}" for node, s in self._states.items() if s != ACTIVE_STATE)

    def _is_placed(self, since_s: float) -> bool:
        place = self.localization.place
        return place is not None and place.arrived_s > since_s

    def _is_heard(self, since_s: float) -> bool:
        """Return whether there has been a sign of life from the robot."""
        shared = self._entry.named(self.name, self._entry.tf)  # other robots' transforms, too
        own = (need.name for need in self._watch.needed if need.name != shared)
        heard = any(self._watch.last_s(name) > since_s for name in own)
        return bool(self._servers) or heard or self._is_placed(since_s)

    def examine(self) -> Iterator[LinkFinding]:
        """Yield findings about the robot: readiness, action servers, messages, place, nodes."""
        heard = self._is_heard(time.monotonic() - SILENT_S)
        yield readiness_finding(self.name, self.readiness.why if heard else "it sends nothing")
        servers, action = self.server.servers, self.server.action
        alone = LinkFinding(self.name, action, count(servers, "action server"))
        yield alone.unless(servers == 1, "1, of bt_navigator", "it accepts no goals")
        yield from self._watch.findings(self.name, time.monotonic())
        entry, seen = self._entry, self.navigator.seen
        at = f"at ({seen.at[0]:.1f}, {seen.at[1]:.1f})" if seen is not None else "unknown"
        place = LinkFinding(self.name, f"{entry.map_frame} to {entry.base_frame}", at)
        yield place.unless(seen, "transforms, from AMCL or SLAM", "it is not shown")
        for node, state in dict(self._states).items():
            managed = LinkFinding(self.name, node, state)
            yield managed.unless(state == ACTIVE_STATE, ACTIVE_STATE, "it cannot start")

    def _take(self, topic: str, take: Callable[[Any], None], message: Any) -> None:
        """Process one message; an invalid message is reported and otherwise ignored."""
        try:
            take(message)
        except UnreadableError as error:
            self._say("alarm", f"a message on {topic} is set aside: {error}", topic)
        else:
            self._watch.heard(topic, time.monotonic())

    def _goals(self, message: Any) -> None:
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
        transforms = messages.read_transforms(message)
        if not fixed:
            transforms = [self._stamped(each) for each in transforms]
        self.localization.see_transforms(transforms, time.monotonic(), fixed=fixed)
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
        """Return `pose` with the time that applies to it, in seconds (UTC).

        Raises UnreadableError if the robot's clock is ahead by more than AHEAD_S.
        """
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
        """Report the robot's state about once in each telemetry period of its own clock."""
        place = self.localization.place
        if place is None:
            return
        if self._speed_s == -math.inf:
            self._say("alarm", "is not shown without odometry: name its topic as 'odom'")
            return
        pose = self._site.fit.to_world(place.pose)
        arrived_s = min(place.arrived_s, self._speed_s)
        self.navigator.seen = Seen((pose.x, pose.y), self._speed_mps, arrived_s)
        # A report may come a little early. Waiting for a full period would skip every other report.
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
        """Emit a notice, unless one about the same subject was emitted within QUIET_S."""
        now_s = time.monotonic()
        if now_s - self._told.get(about or text, -math.inf) >= QUIET_S:
            self._told[about or text] = now_s
            self._tell(LinkNotice(level, self.name, text))
