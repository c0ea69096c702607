"""The drone of the manual, run from the page, flies every order of the page."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from pa_console.fleets.mavlink.link import open_link
from pa_console.schema.world import Origin, World
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.geography import Geography
from tests.fleets.mavlink.drones import Driven, free_port

PAGE = Path(__file__).parents[3] / "pa_console" / "manual" / "mavlink.md"
DRONE = "Drone_T01"


def block(kind: str, words: str = "") -> str:
    found = re.findall(rf"```{kind}\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    return next(text for text in found if words in text)


def drone_line() -> str:
    return next(line for line in block("sh", "drone.py").splitlines() if "drone.py" in line)


@pytest.fixture
def driven(world: World, tmp_path: Path) -> Iterator[Driven]:
    port = free_port()
    (tmp_path / "drones.yaml").write_text(block("yaml", "14540"), encoding="utf-8")
    (tmp_path / "drone.py").write_text(block("python"), encoding="utf-8")
    words = drone_line().split()[1:]
    words[1] = f"127.0.0.1:{port}"
    process = subprocess.Popen([sys.executable, *words], cwd=tmp_path, env={**os.environ})
    try:
        link = open_link(f"udpin://127.0.0.1:{port}#{tmp_path / 'drones.yaml'}", world, Settings())
        yield Driven(link)
        link.close()
    finally:
        process.kill()
        process.wait()


def test_it_observes_moves_holds_and_returns(driven: Driven) -> None:
    driven.until(lambda: driven.fenced(1))
    assert driven.reports[DRONE].status == "ok"
    driven.send("c1", DRONE, "observe", "EastGate")
    assert driven.end("c1").detail == "at EastGate"
    driven.send("c2", DRONE, "move_to", "Base")
    driven.until(lambda: driven.reports[DRONE].speed_mps > 1.0)
    driven.send("c3", DRONE, "hold")
    assert driven.end("c3").status == "done"
    assert driven.end("c2").status == "failed"
    driven.send("c4", DRONE, "return_to_base")
    assert driven.end("c4").detail == "at Base"


def test_the_page_puts_it_at_the_base_of_the_checkpoint(world: World) -> None:
    origin = Origin(**yaml.safe_load(block("yaml", "14540"))["origin"])
    at = drone_line().split()[-2:]
    place = Geography(origin).metres(float(at[0]), float(at[1]))
    assert place == pytest.approx(world.frames["Base"].at, abs=0.1)


def test_it_needs_nothing_of_ours_and_is_short() -> None:
    lines = [line for line in block("python").splitlines() if line.strip()]
    assert not [line for line in lines if "pa_console" in line]
    assert len(lines) <= 100
