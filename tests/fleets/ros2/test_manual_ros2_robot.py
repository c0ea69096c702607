"""The robot of the manual, run from the page, carries out the orders of the page."""

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from pa_console.fleets.ros2.link import Ros2Link, open_link
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from tests.fleets.ros2.counterpart import Listener, free_port

PAGE = Path(__file__).parents[3] / "pa_console" / "manual" / "ros2.md"


def block(kind: str) -> str:
    return re.findall(rf"```{kind}\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)[0]


@pytest.fixture
def listener(world: World, tmp_path: Path) -> Iterator[Listener]:
    port = free_port()
    (tmp_path / "robots.yaml").write_text(block("yaml"), encoding="utf-8")
    (tmp_path / "robot.py").write_text(block("python"), encoding="utf-8")
    words = next(line for line in block("sh").splitlines() if "robot.py" in line).split()[1:]
    words[1] = str(port)
    robot = subprocess.Popen([sys.executable, *words], cwd=tmp_path)
    try:
        link = opened(f"tcp/127.0.0.1:{port}#{tmp_path / 'robots.yaml'}", world)
        yield Listener(link)
        link.close()
    finally:
        robot.kill()
        robot.wait()


def opened(address: str, world: World) -> Ros2Link:
    """Return the link, once the robot shows that it takes goals."""
    until_s = time.monotonic() + 60.0
    while True:
        try:
            return open_link(address, world, Settings())
        except ValueError:
            assert time.monotonic() < until_s


def test_it_moves_holds_reports_and_returns(listener: Listener, world: World) -> None:
    listener.heard("Ugv_T01")
    assert listener.link.layout == "bridge"
    report = listener.report("Ugv_T01")
    assert report is not None
    assert report.position == world.frames["Base"].at
    listener.send("a", "Ugv_T01", "move_to", "EastGate")
    listener.until(lambda: (r := listener.report("Ugv_T01")) and r.speed_mps > 0.0)
    listener.send("h", "Ugv_T01", "hold")
    assert listener.final("h").status == "done"
    assert listener.final("a").detail == "stopped by a hold"
    listener.send("r", "Ugv_T01", "report")
    assert listener.final("r").status == "done"
    listener.send("b", "Ugv_T01", "return_to_base")
    assert listener.final("b").detail == "at Base"
    listener.send("w", "Ugv_T01", "warn", "EastGate")
    assert listener.final("w").status == "refused"


def test_it_needs_nothing_of_ours_and_is_short() -> None:
    lines = [line for line in block("python").splitlines() if line.strip()]
    assert not [line for line in lines if "pa_console" in line]
    assert len(lines) <= 100
