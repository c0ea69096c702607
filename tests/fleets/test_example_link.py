"""The link of the manual drives the robot of the manual, which is a program of its own."""

import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from pa_console.fleets import link as links
from pa_console.fleets.link import GROUP, open_link
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.newcomers import survey
from pa_console.schema.command import CommandReply, DeviceCommand, Verb
from pa_console.schema.world import World
from pa_console.settings.schema import Settings

PAGE = Path(__file__).parents[2] / "pa_console" / "manual" / "connect-a-robot.md"
ROBOT = "Robot_T02"
LIMIT_S = 300.0


def program(name: str) -> str:
    """Return the program of the page that is saved as `name`."""
    saved = PAGE.read_text("utf-8").partition(f"`{name}`")[2]
    found = re.search(r"```python\n(.*?)```", saved, re.DOTALL)
    assert found is not None
    return found.group(1)


@pytest.fixture(autouse=True)
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install the link as the page says."""
    (tmp_path / "lines_link.py").write_text(program("lines_link.py"), encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    point = EntryPoint("lines", "lines_link:open_link", GROUP)
    monkeypatch.setattr(links, "link_schemes", lambda: {"lines": point})


@pytest.fixture
def url(tmp_path: Path) -> Iterator[str]:
    """The address of the robot of the page, which runs."""
    (tmp_path / "walker.py").write_text(program("walker.py"), encoding="utf-8")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen([sys.executable, "walker.py", str(port)], cwd=tmp_path)
    yield f"lines:127.0.0.1:{port}/{ROBOT}"
    process.kill()
    process.wait()


class Driven:
    """Steps a fleet in real time."""

    def __init__(self, fleet: LinkedFleet) -> None:
        self.fleet = fleet
        self.replies: list[CommandReply] = []

    def until(self, done: Callable[[], bool]) -> None:
        """Step until `done`; raises TimeoutError when that takes too long."""
        end = time.monotonic() + LIMIT_S
        while not done():
            if time.monotonic() > end:
                raise TimeoutError(str(self.replies[-3:]))
            self.replies += self.fleet.step().replies
            self.fleet.links[0].wait(self.fleet.world.dt_s)

    def order(self, number: int, verb: Verb, target: str | None = None) -> str:
        """Send a command; return its id."""
        name = f"M1.{number}"
        self.fleet.send(DeviceCommand(command_id=name, agent=ROBOT, verb=verb, target=target))
        return name

    def last(self, command_id: str) -> str:
        """Return the status of the last reply to a command, "" for none."""
        said = [reply.status for reply in self.replies if reply.command_id == command_id]
        return said[-1] if said else ""

    def end(self, command_id: str) -> str:
        """Step until a command has ended; return how."""
        self.until(lambda: self.last(command_id) in ("done", "failed", "refused"))
        return self.last(command_id)


def opened(url: str, world: World) -> links.Link:
    until = time.monotonic() + LIMIT_S
    while True:
        try:
            return open_link(url, world, Settings())
        except ValueError:
            if time.monotonic() > until:
                raise


def test_it_moves_stops_and_refuses(url: str, world: World) -> None:
    with closing(LinkedFleet(world, [opened(url, world)])) as fleet:
        driven = Driven(fleet)

        def robot() -> object:
            return fleet.picture().assets[ROBOT]

        driven.until(lambda: fleet.picture().assets[ROBOT].available)
        assert fleet.picture().assets[ROBOT].at == "Base", robot()
        away = driven.order(1, "move_to", "WestGate")
        driven.until(lambda: fleet.picture().assets[ROBOT].speed_mps > 0.0)
        assert fleet.picture().assets[ROBOT].post == "WestGate"
        assert driven.end(driven.order(2, "hold")) == "done"
        driven.until(lambda: fleet.picture().assets[ROBOT].task == "holding")
        assert driven.end(away) == "failed"
        assert driven.end(driven.order(3, "warn", "EastGate")) == "refused"
        assert driven.end(driven.order(4, "report")) == "done"
        assert driven.end(driven.order(5, "return_to_base")) == "done"
        driven.until(lambda: fleet.picture().assets[ROBOT].at == "Base")


def test_a_look_at_it_says_who_reports(url: str, world: World) -> None:
    seen = survey(opened(url, world), LIMIT_S)
    assert seen.in_words() == f"{url}: connected; reports from {ROBOT}"


def test_a_robot_that_is_off_and_a_wrong_address_are_named(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    import lines_link  # noqa: PLC0415 # pyright: ignore[reportMissingImports]

    monkeypatch.setattr(lines_link, "SILENT_S", 0.1)  # pyright: ignore[reportUnknownArgumentType]
    for address, why in (("127.0.0.1:9/Robot_T02", "no robot answers"), ("here", "HOST:PORT")):
        with pytest.raises(ValueError, match=why):
            open_link(f"lines:{address}", world, Settings())


def test_it_is_short() -> None:
    lines = [line for line in program("lines_link.py").splitlines() if line.strip()]
    assert len(lines) < 100
