"""Drones in another process, and a link to them."""

import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pa_console.fleets.link import DeviceAnswer, LinkNotice, NotReady
from pa_console.fleets.mavlink.link import MavlinkLink, open_link
from pa_console.fleets.reports import AssetReport
from pa_console.schema.command import FINAL_REPLIES, DeviceCommand, Verb
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from tests.fleets.mavlink.scripted import GEOGRAPHY, ORIGIN

LIMIT_S = 120.0
ARDUPILOT = 3


def free_port() -> int:
    """Return a UDP port that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def on_the_earth(world: World) -> World:
    """Return the world with a place on the earth."""
    return world.model_copy(update={"origin": ORIGIN})


def vehicles_file(folder: Path, world: World, names: Sequence[str], more: str = "") -> Path:
    """Write the file of drones, the first of which has the system id 1."""
    lines = [f"  {name}: {{system_id: {number}}}" for number, name in enumerate(names, 1)]
    path = folder / "drones.yaml"
    path.write_text("\n".join(["vehicles:", *lines, more, ""]), encoding="utf-8")
    return path


class Drones:
    """The vehicles of `tests.fleets.mavlink.vehicles`, one for each name, as a process."""

    def __init__(
        self,
        port: int,
        world: World,
        names: Sequence[str],
        *options: str,
        flies: bool = True,
        autopilots: Sequence[int] = (),
    ) -> None:
        self.port = port
        self.ids = {name: number for number, name in enumerate(names, 1)}
        home = GEOGRAPHY.degrees(world.frames[world.base].at)
        vehicles: list[dict[str, Any]] = []
        for name, number in self.ids.items():
            post = GEOGRAPHY.degrees(world.frames[world.assets[name].post].at)
            each: dict[str, Any] = {"system": number, "at": post if flies else home, "home": home}
            each |= {"flies": flies, "height": 20.0}
            if number <= len(autopilots):
                each["autopilot"] = autopilots[number - 1]
            vehicles.append(each)
        module, target = "tests.fleets.mavlink.vehicles", f"127.0.0.1:{port}"
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, *options, target, json.dumps(vehicles)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def tell(self, name: str, **line: Any) -> None:
        """Change how one of them behaves, all of them for ''; it has changed on return."""
        assert self._process.stdin is not None
        whom = {"system": self.ids[name]} if name else {"all": True}
        self._process.stdin.write(json.dumps(whom | line) + "\n")
        self.say()

    def say(self) -> dict[str, dict[str, Any]]:
        """Return what each has done, by its name."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write('{"say": true}\n')
        self._process.stdin.flush()
        said = json.loads(self._process.stdout.readline())
        return {name: said[str(number)] for name, number in self.ids.items()}

    def kill(self) -> None:
        """End them."""
        self._process.kill()
        self._process.communicate()


class Driven:
    """A link, and all that has come over it."""

    def __init__(self, link: MavlinkLink) -> None:
        self.link = link
        self.answers: list[DeviceAnswer] = []
        self.notices: list[LinkNotice] = []
        self.reports: dict[str, AssetReport] = {}
        self.readiness: list[tuple[str, str]] = []
        """Why vehicles were not ready, and '' when they were, in order."""

    def take(self) -> None:
        """Take in what has come."""
        for news in self.link.take():
            match news:
                case AssetReport():
                    self.reports[news.agent] = news
                case DeviceAnswer():
                    self.answers.append(news)
                case LinkNotice():
                    self.notices.append(news)
                case NotReady(agent, why):
                    self.readiness.append((agent, why))
                case _:
                    pass

    @property
    def not_ready(self) -> dict[str, str]:
        """Why each vehicle is not ready, '' if it is."""
        return dict(self.readiness)

    def until(self, done: Callable[[], bool], limit_s: float = LIMIT_S) -> None:
        """Take news in until `done`; raises TimeoutError when that takes too long."""
        end = time.monotonic() + limit_s
        while not done():
            if time.monotonic() > end:
                raise TimeoutError(f"{self.answers[-3:]} {self.notices[-3:]}")
            self.link.wait(0.5)
            self.take()

    def send(self, name: str, agent: str, verb: Verb, target: str | None = None) -> None:
        """Send a command."""
        self.link.send(DeviceCommand(command_id=name, agent=agent, verb=verb, target=target))

    def last(self, name: str) -> DeviceAnswer | None:
        """Return the last answer to a command."""
        return next((a for a in reversed(self.answers) if a.command_id == name), None)

    def end(self, name: str) -> DeviceAnswer:
        """Wait for the end of a command; return how it ended."""
        self.until(lambda: (last := self.last(name)) is not None and last.status in FINAL_REPLIES)
        last = self.last(name)
        assert last is not None
        return last

    def told(self, words: str) -> bool:
        """Return whether a notice has these words."""
        return any(words in notice.text for notice in self.notices)

    def fenced(self, count: int) -> bool:
        """Return whether so many drones are shown and have the world's fence."""
        told = sum("read back and is the world's" in n.text for n in self.notices)
        return min(told, len(self.reports)) >= count


@contextmanager
def flown(
    world: World, folder: Path, names: Sequence[str], *options: str, more: str = "", **kinds: Any
) -> Generator[tuple[Driven, Drones]]:
    """Yield a link to drones that have the world's fence."""
    world, port = on_the_earth(world), free_port()
    file = vehicles_file(folder, world, names, more)
    drones = Drones(port, world, names, *options, **kinds)
    try:
        link = open_link(f"udpin://127.0.0.1:{port}#{file}", world, Settings())
        driven = Driven(link)
        try:
            yield driven, drones
        finally:
            link.close()
    finally:
        drones.kill()
