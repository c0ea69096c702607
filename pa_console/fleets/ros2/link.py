"""A link to robots that navigate with Nav2: `--fleet ros2:FILE.yaml`.

The thread of the ROS 2 node does everything; the station's thread hands it commands and takes news.
"""

import time
from collections import deque
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from threading import Event

from pa_console.fleets.link import DeviceAnswer, FoundRobot, LinkNews, LinkNotice
from pa_console.fleets.ros2.connection import RobotSite, read_site
from pa_console.fleets.ros2.navigator import HELD
from pa_console.fleets.ros2.robot import Robot
from pa_console.schema.command import DeviceCommand
from pa_console.schema.document import DocumentError
from pa_console.schema.world import World
from pa_console.settings.schema import Settings

PATIENCE_S = 10.0
"""The longest wait for a robot when a link is opened, seconds."""

MOST_NEWS = 20_000
"""The news that may wait to be taken; the oldest gives way."""


class Ros2Link:
    """The robots of one file."""

    def __init__(self, path: Path, site: RobotSite) -> None:
        """Raises ImportError where there is no ROS 2."""
        self.name, self.agents = f"ros2:{path}", frozenset(site.connection.robots)
        self._site, self._arrived = site, Event()
        self._news: deque[LinkNews] = deque(maxlen=MOST_NEWS)
        self._commands: deque[DeviceCommand] = deque()
        node = import_module("pa_console.fleets.ros2.node")
        self._node = node.RosNode(site.connection.domain, self._fault)
        self._robots = {
            name: Robot(name, site, node.Nav2Server(self._node, name, entry), self._tell)
            for name, entry in site.connection.robots.items()
        }
        for robot in self._robots.values():
            robot.listen(self._node)
        self._node.start(self._step)

    @property
    def problem(self) -> str:
        """The reason why no robot can be commanded, '' while one can."""
        actions = [robot.server.action for robot in self._robots.values()]
        if any(self._node.servers.get(action) for action in actions):
            return ""
        return f"no action server in ROS domain {self._node.domain} is called {', '.join(actions)}"

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
        for action in sorted(action for action, count in self._node.servers.items() if count):
            if (robot := named.get(action)) is None:
                name = action.rpartition("/")[0].strip("/").replace("/", "_")
                found.append(FoundRobot(name, "robot", None, f"ROS 2, {action}"))
                continue
            kind, seen = self._site.world.assets[robot.name].kind, robot.navigator.seen
            at = seen.at if seen is not None else None
            found.append(FoundRobot(robot.name, kind, at, f"ROS 2, {action}"))
        return found

    def close(self) -> None:
        """End the node; the robots do what they do without a station."""
        self._node.close()

    def _send(self) -> None:
        """Send the commands that wait; no motion that waits goes out before a hold."""
        waiting = [self._commands.popleft() for _ in range(len(self._commands))]
        for place, command in enumerate(waiting):
            held = {each.agent for each in waiting[place:] if each.verb == "hold"}
            if command.verb != "hold" and command.agent in held:
                said = (command.command_id, command.agent, "refused", HELD)
                self._tell(DeviceAnswer(*said))
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
        link = Ros2Link(path, read_site(path, world))
    except DocumentError as error:
        raise ValueError(str(error)) from error
    except ImportError as error:
        raise ValueError(
            f"--fleet ros2:{address}: ROS 2 cannot be loaded ({error}): run 'source "
            "/opt/ros/DISTRO/setup.bash', and install pa-console in a virtual environment made by "
            "'/usr/bin/python3 -m venv --system-site-packages' (see 'pa-console manual ros2')"
        ) from error
    until_s = time.monotonic() + PATIENCE_S
    while (problem := link.problem) and time.monotonic() < until_s:
        time.sleep(0.05)
    if problem:
        link.close()
        raise ValueError(
            f"--fleet ros2:{address}: {problem}: start the robots, and check their namespaces and "
            "ROS_DOMAIN_ID; 'ros2 action list' shows what is there"
        )
    return link
