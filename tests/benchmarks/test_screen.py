"""The benchmark `screen`: a loop that is held up is noticed, and what is printed of it."""

import asyncio
import time
from collections.abc import Callable

import pytest

from pa_console.llm.models.catalogue import LocalModel
from tests.benchmarks import screen
from tests.benchmarks.conftest import Measure
from tests.benchmarks.screen import LoopBlocks, LoopWatch
from tests.scripted import ScriptedEngine

BLOCK_S = 0.08


def hold_up() -> None:
    time.sleep(BLOCK_S)


async def test_a_block_is_as_long_as_the_loop_was_held_up_and_names_where() -> None:
    async with LoopWatch("held up") as watch:
        await asyncio.sleep(0.01)
        hold_up()
        await asyncio.sleep(0.01)
    found = watch.blocks
    assert found.scene == "held up"
    assert found.longest_s > BLOCK_S / 2
    assert found.seconds > BLOCK_S
    assert found.late_99_s <= found.longest_s
    assert "hold_up" in found.during


async def test_what_was_computed_is_told_apart_from_what_was_waited() -> None:
    async with LoopWatch("computing") as watch:
        await asyncio.sleep(0.01)
        began = time.thread_time()
        while time.thread_time() - began < BLOCK_S:
            pass
    assert watch.blocks.computing_s >= BLOCK_S
    async with LoopWatch("waiting") as watch:
        await asyncio.sleep(0.01)
        hold_up()
    assert watch.blocks.computing_s < watch.blocks.longest_s


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let two scenes have been measured."""

    async def measure(
        _model: LocalModel, _seconds: float, tell: Callable[[str], None]
    ) -> list[LoopBlocks]:
        tell("a console")
        return [
            LoopBlocks(
                scene=name, seconds=5.0, beats=9, late_99_s=0.004, longest_s=longest_s,
                computing_s=0.02, during="orchestrator.rehearse",
            )
            for name, longest_s in (("idle", 0.03), ("planning", 0.2))
        ]  # fmt: skip

    def find_model(_: str | None) -> LocalModel:
        return ScriptedEngine([]).model

    monkeypatch.setattr(screen, "_measure", measure)
    monkeypatch.setattr(screen, "find_model", find_model)


@pytest.mark.usefixtures("measured")
def test_blocks_stand_beside_the_goal(bench: Measure) -> None:
    done = bench("screen")
    assert done.code == 0, done.err
    rows = {line.split()[0]: line.split() for line in done.out.splitlines() if ".0" in line}
    assert rows["idle"][1:7] == ["5.0", "4.0", "30.0", "20.0", "100", "yes"]
    assert rows["planning"][1:7] == ["5.0", "4.0", "200.0", "20.0", "100", "NO"]


@pytest.mark.usefixtures("measured")
def test_the_report_has_every_scene(bench: Measure) -> None:
    report = bench("screen").figures
    assert [scene["scene"] for scene in report["scenes"]] == ["idle", "planning"]
    assert report["model"] == "scripted"
