"""The robot of the manual, run from the page, carries out the orders of the page."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from pa_console.fleets.ros2.connection import read_site
from pa_console.schema.world import World
from tests.fleets.ros2.counterpart import REMEDY, Listener, free_domain, linked

PAGE = Path(__file__).parents[3] / "pa_console" / "manual" / "ros2.md"


def block(kind: str) -> str:
    return re.findall(rf"```{kind}\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)[0]


@pytest.fixture
def listener(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Listener]:
    pytest.importorskip("rclpy", reason=REMEDY)
    domain = free_domain()
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    (tmp_path / "robot.py").write_text(block("python"), encoding="utf-8")
    line = re.search(r"robot.py (\S+) (\S+) (\S+)\n", PAGE.read_text("utf-8"))
    assert line is not None
    robot = subprocess.Popen([sys.executable, "robot.py", *line.groups()], cwd=tmp_path)
    try:
        text = block("yaml").replace("/ugv1}", "/ugv1, pose: odom}")
        with linked(domain, world, tmp_path, text, "") as listener:
            yield listener
    finally:
        robot.kill()
        robot.wait()


def test_it_moves_holds_reports_and_returns(listener: Listener, world: World) -> None:
    listener.heard("Ugv_T01")
    report = listener.report("Ugv_T01")
    assert report is not None
    assert report.position == pytest.approx(world.frames["Base"].at)
    listener.send("a", "Ugv_T01", "move_to", "EastGate")
    listener.moving("Ugv_T01")
    listener.send("h", "Ugv_T01", "hold")
    assert listener.final("h").status == "done"
    assert listener.final("a").detail == "stopped by a hold"
    listener.send("r", "Ugv_T01", "report")
    assert listener.final("r").status == "done"
    listener.send("b", "Ugv_T01", "return_to_base")
    assert listener.final("b").detail == "at Base"
    listener.send("w", "Ugv_T01", "warn", "EastGate")
    assert listener.final("w").status == "refused"


def test_the_file_of_the_page_is_read(world: World, tmp_path: Path) -> None:
    path = tmp_path / "robots.yaml"
    path.write_text(block("yaml"), encoding="utf-8")
    assert set(read_site(path, world).connection.robots) == {"Ugv_T01"}


def test_it_needs_nothing_of_ours_and_is_short() -> None:
    lines = [line for line in block("python").splitlines() if line.strip()]
    assert not [line for line in lines if "pa_console" in line]
    assert len(lines) <= 100
