"""Robots in another process, and the link that commands them."""

import json
import random
import subprocess
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any, TypeVar

from pa_console.fleets.link import AssetReport, DeviceAnswer, LinkNews, LinkNotice, NotReady
from pa_console.fleets.ros2.link import Ros2Link, open_link
from pa_console.schema.command import FINAL_REPLIES, DeviceCommand, Verb
from pa_console.schema.world import World
from pa_console.settings.schema import Settings

LIMIT_S = 30.0
REMEDY = "ROS 2 is not here: see tests/fleets/ros2/install_ros.sh"
FRAMES = "frames: {NorthGate: [0, 34], EastGate: [54, 0], Base: [40, -26]}\n"
T = TypeVar("T")


def free_domain() -> int:
    """Return a ROS domain that other tests of this machine hardly use at the same time."""
    return random.SystemRandom().randint(1, 100)


class Robots:
    """Robots by namespace and place, in a process of their own."""

    def __init__(self, robots: dict[str, tuple[float, float]], domain: int | None = None) -> None:
        self.domain = domain if domain is not None else free_domain()
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "tests.fleets.ros2.nav2_robot"),
                *("--domain", str(self.domain), json.dumps(robots)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._line() == "ready\n"

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def change(self, **changes: dict[str, Any]) -> dict[str, Any]:
        """Set attributes of robots; return the state of all of them."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(changes) + "\n")
        self.process.stdin.flush()
        return json.loads(self._line())

    def kill(self) -> None:
        """End the process as a crash does: nothing is said to anybody."""
        self.process.kill()
        self.process.wait(LIMIT_S)

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(LIMIT_S)


class Listener:
    """Everything that a link has brought, and waiting for what it should bring."""

    def __init__(self, link: Ros2Link) -> None:
        self.link = link
        self.news: list[LinkNews] = []

    @property
    def answers(self) -> list[DeviceAnswer]:
        """The answers so far."""
        return [each for each in self.news if isinstance(each, DeviceAnswer)]

    @property
    def notices(self) -> list[str]:
        """The notices so far, each with its subject in front."""
        return [f"{n.subject} {n.text}" for n in self.news if isinstance(n, LinkNotice)]

    def report(self, agent: str) -> AssetReport | None:
        """Return the latest report of `agent`."""
        found = (n for n in reversed(self.news) if isinstance(n, AssetReport) and n.agent == agent)
        return next(found, None)

    def not_ready(self, agent: str) -> str:
        """Return why `agent` cannot start, '' if it can."""
        states = (n for n in reversed(self.news) if isinstance(n, NotReady) and n.agent == agent)
        return next((state.why for state in states), "")

    def until(self, found: Callable[[], T | None], limit_s: float = LIMIT_S) -> T:
        """Take in news until `found` returns something; return that."""
        until_s = monotonic() + limit_s
        while True:
            result = found()
            if result:
                return result
            assert monotonic() < until_s, (self.link.problem, self.notices, self.answers[-10:])
            self.link.wait(0.1)
            self.news += self.link.take()

    def statuses(self, command_id: str) -> list[str]:
        """Return the statuses of the answers to a command."""
        return [a.status for a in self.answers if a.command_id == command_id]

    def final(self, command_id: str) -> DeviceAnswer:
        """Wait for the last answer to a command."""
        return self.until(
            lambda: next(
                (
                    a
                    for a in self.answers
                    if a.command_id == command_id and a.status in FINAL_REPLIES
                ),
                None,
            )
        )

    def heard(self, *agents: str) -> None:
        """Wait for a report of each of `agents`, with its charge, and for its action server."""
        self.until(
            lambda: all(
                (report := self.report(agent)) is not None
                and report.battery_pct is not None
                and any(n.startswith(f"{agent} its action server") for n in self.notices)
                for agent in agents
            )
        )

    def moving(self, agent: str) -> None:
        """Wait until `agent` reports that it moves."""
        self.until(lambda: (r := self.report(agent)) is not None and r.speed_mps > 0.0)

    def rest(self, count: int = 6) -> None:
        """Wait for so many more reports, in which nothing may happen."""
        before = len(self.news)
        self.until(lambda: len(self.news) > before + count)

    def send(self, command_id: str, agent: str, verb: Verb, target: str | None = None) -> None:
        """Send a command."""
        self.link.send(DeviceCommand(command_id=command_id, agent=agent, verb=verb, target=target))


@contextmanager
def linked(
    domain: int, world: World, folder: Path, text: str, frames: str = FRAMES
) -> Generator[Listener]:
    """Yield the link to the robots of a connection file in a ROS domain."""
    path = folder / "robots.yaml"
    path.write_text(f"domain: {domain}\n{frames}{text}")
    link = open_link(str(path), world, Settings())
    try:
        yield Listener(link)
    finally:
        link.close()


@dataclass(frozen=True)
class Press:
    """What came of one STOP, seconds from its press; one figure a robot."""

    wire_s: list[float]
    """Until the request to cancel arrived."""
    stood_s: list[float]
    """Until the robot stood."""
    done_s: list[float]
    """Until that was confirmed."""
    sent_after: int
    """The goals that came after that."""


def stop(robots: Robots, listener: Listener, names: Sequence[str], number: int) -> Press:
    """Order robots about, and stop them in motion."""
    gate = ("EastGate", "WestGate")[number % 2]
    for name in names:
        listener.send(f"go {number} {name}", name, "move_to", gate)
    for name in names:
        listener.until(lambda name=name: robots.change()[name]["speed"] > 0.0)
    done, pressed_s = dict[str, float](), monotonic()
    for name in names:
        listener.send(f"stop {number} {name}", name, "hold")
    while len(done) < len(names):
        for name in names:
            if "done" in listener.statuses(f"stop {number} {name}"):
                done.setdefault(name, monotonic() - pressed_s)
        assert monotonic() - pressed_s < LIMIT_S
        listener.link.wait(0.02)
        listener.news += listener.link.take()
    state = robots.change()
    for name in names:
        state[name]["cancelled_s"] -= pressed_s
        state[name]["stood_s"] -= pressed_s
    return Press(
        [state[name]["cancelled_s"] for name in names],
        [state[name]["stood_s"] for name in names],
        list(done.values()),
        sum(at_s > pressed_s for name in names for at_s in state[name]["went_s"]),
    )
