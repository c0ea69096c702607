"""The link to robots that navigate with Nav2: `--fleet ros2:FILE.yaml`.

The thread of the ROS 2 node does all the work. The station's thread only passes commands to it and
takes news from it.
"""

import time
from collections import deque
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from pa_console.fleets.link import (
    DeviceAnswer,
    FoundRobot,
    GroundMap,
    LinkFinding,
    LinkNotice,
)
from pa_console.fleets.ros2.connection import RobotSite, read_site
from pa_console.fleets.ros2.messages import UnreadableError, read_grid
from pa_console.fleets.ros2.navigator import HELD
from pa_console.fleets.ros2.robot import Robot
from pa_console.fleets.snapshot import MOST_BYTES, MOST_S, SnapshotError, safe_image
from pa_console.fleets.threaded_link import ThreadedLink, opened
from pa_console.schema.command import DeviceCommand
from pa_console.schema.document import DocumentError
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.occupancy_map import background_of

IMAGE = "sensor_msgs/msg/CompressedImage"

MAP_S = 5.0
"""The least time between two maps that are processed, in seconds."""


class Ros2Link(ThreadedLink):
    """The link to the robots of one connection file."""

    def __init__(self, path: Path, site: RobotSite) -> None:
        """Start the node and subscribe; raises ImportError if ROS 2 is not installed."""
        super().__init__(f"ros2:{path}")
        self._site, self.agents = site, frozenset(site.connection.robots)
        self._map_frames = {entry.map_frame for entry in site.connection.robots.values()}
        self._map: Any = None
        """The newest map, until it is processed."""
        self._maps, self._map_s = 0, -MAP_S
        self._commands: deque[DeviceCommand] = deque()
        node = import_module("pa_console.fleets.ros2.node")
        self._node = node.RosNode(site.connection.domain, self._guarded)
        self._robots = {
            name: Robot(name, site, node.Nav2Server(self._node, name, entry), self._tell)
            for name, entry in site.connection.robots.items()
        }
        for robot in self._robots.values():
            robot.listen(self._node, node.ManagedNode)
        if (topic := site.connection.map) is not None:
            name, kind = f"/{topic.lstrip('/')}", "nav_msgs/msg/OccupancyGrid"
            self._node.listen(name, kind, self._note_map, kept=True, depth=1)
        self._node.start(self._step)

    @property
    def problem(self) -> str:
        """The reason why no robot can be commanded; '' while at least one can."""
        actions = [robot.server.action for robot in self._robots.values()]
        if any(self._node.servers.get(action) for action in actions):
            return ""
        return f"no action server in ROS domain {self._node.domain} is called {', '.join(actions)}"

    def send(self, command: DeviceCommand) -> None:
        """Let the node's thread send `command` to its robot; returns at once."""
        self._commands.append(command)
        self._node.post(self._send)

    def discover(self) -> Sequence[FoundRobot]:
        """Return a robot for each action server `NavigateToPose` in the domain."""
        named = {robot.server.action: robot for robot in self._robots.values()}
        robots: list[FoundRobot] = []
        for action in sorted(action for action, count in self._node.servers.items() if count):
            if (robot := named.get(action)) is None:
                name = action.rpartition("/")[0].strip("/").replace("/", "_")
                robots.append(FoundRobot(name, "robot", None, f"ROS 2, {action}"))
                continue
            kind, seen = self._site.world.assets[robot.name].kind, robot.navigator.seen
            at = seen.at if seen is not None else None
            robots.append(FoundRobot(robot.name, kind, at, f"ROS 2, {action}"))
        return robots

    def image_on(self, topic: str, limit_s: float = MOST_S) -> bytes:
        """Return the next image on `topic`; raises SnapshotError if there is no valid image."""
        try:
            message = self._node.next_message(topic, IMAGE, MOST_BYTES, limit_s)
        except TimeoutError:
            raise SnapshotError(f"sends no image on {topic} within {limit_s:g} s") from None
        except UnreadableError:
            raise SnapshotError(f"sends more than {MOST_BYTES // 1_000_000} MB") from None
        return safe_image(bytes(message.data))

    def examine(self, seconds: float) -> Sequence[LinkFinding]:
        """Return findings about every robot, about their map, and about cameras with a topic."""
        findings = [finding for robot in self._robots.values() for finding in robot.examine()]
        cameras = {name: spec.image_topic for name, spec in self._site.world.cameras.items()}
        topics = {name: topic for name, topic in cameras.items() if topic}
        for name, topic in topics.items():
            try:
                state = f"an image of {len(self.image_on(topic, seconds / len(topics)))} bytes"
                findings.append(LinkFinding(name, topic, state))
            except SnapshotError as error:
                findings.append(LinkFinding(name, topic, str(error), IMAGE, "no still is shown"))
        if (topic := self._site.connection.map) is not None:
            maps = LinkFinding("all", topic, f"{self._maps} so far" if self._maps else "never")
            wanted = "once, from map_server or SLAM, or set 'map: null'"
            findings.append(maps.unless(self._maps, wanted, "the console does not draw their map"))
        return findings

    def close(self) -> None:
        """End the node; the robots then follow their own rules for a lost link."""
        self._node.close()

    def _send(self) -> None:
        """Send the waiting commands; a motion is refused if a later hold waits with it."""
        waiting = [self._commands.popleft() for _ in range(len(self._commands))]
        for place, command in enumerate(waiting):
            held = {later.agent for later in waiting[place:] if later.verb == "hold"}
            if command.verb != "hold" and command.agent in held:
                refusal = (command.command_id, command.agent, "refused", HELD)
                self._tell(DeviceAnswer(*refusal))
            elif (robot := self._robots.get(command.agent)) is not None:
                robot.navigator.send(command)

    def _step(self) -> None:
        for robot in self._robots.values():
            robot.step()
        topic = self._site.connection.map
        if topic and self._map is not None and time.monotonic() - self._map_s >= MAP_S:
            self._take_map(topic)

    def _note_map(self, message: Any) -> None:
        self._map = message

    def _take_map(self, topic: str) -> None:
        """Process the newest map, placed in the world by the fit of the robots' map."""
        message, self._map, self._map_s = self._map, None, time.monotonic()
        try:
            grid = read_grid(message)
            if grid.frame not in self._map_frames:
                frames = " or ".join(sorted(self._map_frames))
                raise UnreadableError(f"it is in {grid.frame!r}, not in {frames}")
        except UnreadableError as error:
            self._tell(LinkNotice("alarm", self.name, f"the map on {topic} is set aside: {error}"))
            return
        self._maps += 1
        x, y, turn = self._site.fit.to_world(grid.corner)
        self._tell(GroundMap(background_of(grid.occupied, grid.free, (x, y), grid.cell_m, turn)))


def open_link(address: str, world: World, settings: Settings) -> Ros2Link:  # noqa: ARG001
    """Return the link to the robots in the file at `address`, which are assets of `world`.

    Raises ValueError with a remedy if the file is not valid, if ROS 2 is not installed here, or if
    none of the robots is found.
    """
    path = Path(address).expanduser()
    try:
        link = Ros2Link(path, read_site(path, world))
    except DocumentError as error:
        raise ValueError(str(error)) from error
    except ImportError as error:
        raise ValueError(
            f"--fleet ros2:{address}: ROS 2 cannot be loaded ({error}): run 'source "
            "/opt/ros/DISTRO/setup.bash', and install pa-console in a virtual environment made by "
            "'/usr/bin/python3 -m venv --system-site-packages' (see 'pa-console manual ros2')"
        ) from error
    remedy = (
        "start the robots, and check their namespaces and ROS_DOMAIN_ID; 'ros2 action list' shows "
        "what is there"
    )
    return opened(link, f"ros2:{address}", remedy)
