"""Robots in another process, a cable to them that can be cut, and the link that commands them."""

import json
import selectors
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any, TypeVar

from pa_console.fleets.link import AssetReport, DeviceAnswer, LinkNews, LinkNotice
from pa_console.fleets.ros2.link import Ros2Link, open_link
from pa_console.schema.command import FINAL_REPLIES, DeviceCommand, Verb
from pa_console.schema.world import World
from pa_console.settings.schema import Settings

LIMIT_S = 60.0
FRAMES = "frames: {NorthGate: [0, 34], EastGate: [54, 0], Base: [40, -26]}\n"
T = TypeVar("T")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Robots:
    """Counterparts by name and place, on a router at `port`."""

    def __init__(self, robots: dict[str, tuple[float, float]], *options: str) -> None:
        self.port = free_port()
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", "tests.fleets.ros2.nav2_robot"),
                *("--port", str(self.port), *options, json.dumps(robots)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._line() == "ready\n"

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def change(self, **changes: dict[str, Any]) -> dict[str, Any]:
        """Set attributes of robots; return the state of all of them."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(changes) + "\n")
        self._process.stdin.flush()
        return json.loads(self._line())

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(LIMIT_S)


class Cable:
    """Carries TCP between a client and `port`, until it is cut."""

    def __init__(self, port: int) -> None:
        self._to = port
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._whole, self._ended = True, False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def cut(self) -> None:
        """End every connection, and let no new one come about."""
        self._whole = False
        pairs, self._pairs = self._pairs, []
        for pair in pairs:
            for end in pair:
                end.close()

    def mend(self) -> None:
        """Let connections come about again."""
        self._whole = True

    def close(self) -> None:
        """Cut the cable for good."""
        self._ended = True
        self.cut()
        self._server.close()

    def _run(self) -> None:
        while not self._ended:
            try:
                near, _ = self._server.accept()
            except OSError:
                return
            if not self._whole:
                near.close()
                continue
            far = socket.create_connection(("127.0.0.1", self._to))
            self._pairs.append((near, far))
            threading.Thread(target=self._carry, args=(near, far), daemon=True).start()

    def _carry(self, near: socket.socket, far: socket.socket) -> None:
        with selectors.DefaultSelector() as ready:
            try:
                ready.register(near, selectors.EVENT_READ, far)
                ready.register(far, selectors.EVENT_READ, near)
                while True:
                    for key, _ in ready.select(1.0):
                        data = key.fileobj.recv(65536)  # pyright: ignore[reportUnknownMemberType, reportAttributeAccessIssue, reportUnknownVariableType]
                        if not data:
                            raise OSError
                        key.data.sendall(data)
                    if near.fileno() < 0:
                        return
            except (OSError, ValueError):
                near.close()
                far.close()


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

    def until(self, found: Callable[[], T | None], limit_s: float = LIMIT_S) -> T:
        """Take in news until `found` returns something; return that."""
        until_s = monotonic() + limit_s
        while True:
            result = found()
            if result:
                return result
            assert monotonic() < until_s, (self.link.problem, self.news[-10:])
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
        """Wait for a report of each of `agents`."""
        self.until(lambda: all(self.report(agent) for agent in agents))

    def send(self, command_id: str, agent: str, verb: Verb, target: str | None = None) -> None:
        """Send a command."""
        self.link.send(DeviceCommand(command_id=command_id, agent=agent, verb=verb, target=target))


@contextmanager
def linked(
    port: int, world: World, folder: Path, text: str, frames: str = FRAMES
) -> Generator[Listener]:
    """Yield the link to robots of a connection file, at a router on this machine."""
    path = folder / "robots.yaml"
    path.write_text(frames + text)
    link = open_link(f"tcp/127.0.0.1:{port}#{path}", world, Settings())
    try:
        yield Listener(link)
    finally:
        link.close()
