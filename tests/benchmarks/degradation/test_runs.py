"""The degradation benchmark: what it worsens, what it draws, and that it goes on where it was."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.sim.worlds.scenario_file import scenario_problems
from pa_console.station.assembly import Site, load_site
from tests.benchmarks.degradation.runs import (
    CONDITIONS,
    Disturbance,
    RunFile,
    run_once,
    situation,
    summarise,
    worsened,
)
from tests.benchmarks.degradation.true_outcome import RunResult
from tests.scripted import ScriptedEngine, plan

WORLD = load_site("checkpoint", "checkpoint").world


def result(**changes: object) -> RunResult:
    """Return an uneventful run, but for `changes`."""
    values: dict[str, object] = {
        "covered": True, "longest_gap_s": 0.0, "missions": 1, "plans": 1, "halts": 0,
        "passes": 1, "fails": 0, "unknowns": 0,
    }  # fmt: skip
    return RunResult.model_validate(values | changes)


def test_a_condition_worsens_what_it_names_and_nothing_else() -> None:
    assert worsened(WORLD, Disturbance(name="as it is", loss=WORLD.radio.loss)) == WORLD
    noisy = worsened(WORLD, Disturbance(name="noisy", noise_m=10.0, loss=0.6))
    assert noisy.radio.loss == 0.6
    sensors = (*noisy.platforms.values(), *noisy.cameras.values())
    assert {sensor.position_noise_m for sensor in sensors} == {10.0}
    assert noisy.assets == WORLD.assets
    assert noisy.radio.latency_s == WORLD.radio.latency_s


@given(st.integers(0, 10_000), st.sampled_from(CONDITIONS))
def test_every_seed_gives_a_situation_that_the_world_can_play(
    seed: int, condition: Disturbance
) -> None:
    drawn = situation(WORLD, condition, seed)
    assert drawn == situation(WORLD, condition, seed)
    assert list(scenario_problems(drawn, WORLD)) == []
    failing = [event.do.asset for event in drawn.events if event.do.kind == "fail"]
    assert len(failing) == len(set(failing)) == condition.failures


def test_results_are_kept_by_condition_and_seed(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    kept = RunFile(path)
    kept.add("calm", 0, result())
    kept.add("calm", 1, result(halts=2))
    kept.add("storm", 0, result(covered=False))
    for file in (kept, RunFile(path)):
        assert file.results("calm") == {0: result(), 1: result(halts=2)}
        assert file.results("storm") == {0: result(covered=False)}
        assert file.results("fog") == {}
    nowhere = RunFile(None)
    nowhere.add("calm", 0, result())
    assert nowhere.results("calm") == {0: result()}


@pytest.mark.parametrize("line", ["", "{}", "not json", '{"condition": "calm", "seed": 0'])
def test_a_line_that_is_no_result_is_told_by_file_and_number(tmp_path: Path, line: str) -> None:
    path = tmp_path / "runs.jsonl"
    RunFile(path).add("calm", 0, result())
    with path.open("a", encoding="utf-8") as file:
        file.write(line + "\n")
    with pytest.raises(ValueError, match=r"runs\.jsonl:2: .*remove it"):
        RunFile(path)


def test_a_row_sums_the_runs_up_and_shows_what_was_wrong_once() -> None:
    lie, breach = "Drone_T01 is not at WestGate", "ROE-06 Drone_T01"
    row = summarise(
        Disturbance(name="calm"),
        [
            result(longest_gap_s=3.0, halts=1, resent=4),
            result(longest_gap_s=50.0, covered=False, passes=0, unknowns=2),
            result(longest_gap_s=5.0, false_passes=(lie,), broken=(breach,)),
            result(longest_gap_s=4.0, false_passes=(lie, lie), fails=3),
        ],
    )
    assert (row.runs, row.covered_share, row.median_longest_gap_s) == (4, 0.75, 4.5)
    assert (row.passes, row.fails, row.unknowns, row.halts, row.resent) == (3, 3, 2, 1, 4)
    assert (row.false_passes, row.rules_broken, row.examples) == (3, 1, (lie, breach))
    with pytest.raises(ValueError, match="no run"):
        summarise(Disturbance(name="calm"), [])


async def test_a_seed_gives_the_same_result_again_and_no_lie(site: Site) -> None:
    condition = Disturbance(name="two failed", failures=2, loss=0.1)

    async def runs() -> list[RunResult]:
        engine = MemoEngine(ScriptedEngine([plan(("Drone_T04", "report"))]).engine())
        return [await run_once(site, engine, condition, seed) for seed in (4, 5)]

    first = await runs()
    assert all(found.missions for found in first)
    assert all(found.false_passes == found.broken == () for found in first)
    assert first == await runs()
