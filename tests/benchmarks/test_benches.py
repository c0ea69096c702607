"""`python -m tests.benchmarks`: what the benchmarks compare, keep and refuse."""

import shutil
from pathlib import Path

import pytest

from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.llm.models.cache import CACHE_VARIABLE
from pa_console.llm.models.catalogue import LocalModel
from pa_console.schema.incident import Scenario
from pa_console.schema.world import World
from pa_console.sim.worlds.world_file import open_world
from pa_console.station.assembly import Site
from tests.benchmarks import twins
from tests.benchmarks.conftest import Measure
from tests.benchmarks.degradation import degradation
from tests.benchmarks.degradation.runs import Disturbance, RunFile
from tests.benchmarks.degradation.true_outcome import RunResult
from tests.benchmarks.speed.compare import Bench, Comparison
from tests.benchmarks.speed.speed import Part
from tests.benchmarks.speed.without_model import measure_checks
from tests.scripted import ScriptedEngine

SHORT = ("false-alarm", "situation-1-authorized")
RUN = RunResult(
    covered=True, longest_gap_s=0.0, missions=1, plans=2, halts=0, passes=2, fails=0, unknowns=0
)


def few(tmp_path: Path) -> Path:
    """Return a copy of the checkpoint with two of its situations only."""
    own = open_world("checkpoint")[1].parent
    (tmp_path / "scenarios").mkdir()
    shutil.copy(own / "world.yaml", tmp_path)
    for name in SHORT:
        text = (own / "scenarios" / f"{name}.yaml").read_text(encoding="utf-8")
        (tmp_path / "scenarios" / f"{name}.yaml").write_text(text, encoding="utf-8")
    return tmp_path


def test_twins_compares_every_situation_of_the_world_for_every_seed(
    bench: Measure, tmp_path: Path
) -> None:
    world = str(few(tmp_path))
    done = bench("twins", "--world", world, "--seeds", "1")
    assert done.code == 0, done.err
    assert [(row["scenario"], row["seed"], row["equal"]) for row in done.figures] == [
        (name, 0, True) for name in SHORT
    ]
    assert len({row["sha256"] for row in done.figures}) == len(SHORT)


def test_twins_that_differ_end_with_1(
    bench: Measure, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hashes = iter([("a" * 64, "a" * 64), ("b" * 64, "c" * 64)])

    def repeated_hashes(_world: World, _scenario: Scenario, _seed: int) -> tuple[str, str]:
        return next(hashes)

    monkeypatch.setattr(twins, "repeated_hashes", repeated_hashes)
    done = bench("twins", "--world", str(few(tmp_path)), "--seeds", "1")
    assert done.code == 1
    rows = [line.split() for line in done.out.splitlines() if any(n in line for n in SHORT)]
    assert ["yes" in row for row in rows] == [True, False]
    assert "NO" in rows[1]


def test_twins_of_a_world_without_situations_proves_nothing(bench: Measure, tmp_path: Path) -> None:
    world = tmp_path / "world.yaml"
    shutil.copy(open_world("checkpoint")[1], world)
    done = bench("twins", "--world", str(world))
    assert done.code == 2
    assert str(tmp_path) in done.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--only", "mission"], "Did you mean missions?"),
        (["--only", "checks", "--only", "nothing"], "retrieval"),
        (["--only", "decoding", "--model", "gpt-9"], "smollm2-135m"),
        (["--runs", "0"], "--runs"),
        (["--rules", "none.yaml", "--only", "checks"], "none.yaml"),
        (["degradation", "--only", "moonlight"], "link loss 30%"),
        (["degradation", "--model", "gpt-9"], "smollm2-135m"),
        (["degradation", "--runs", "0"], "--runs"),
        (["twins", "--seeds", "0"], "--seeds"),
        (["start", "--runs", "0"], "--runs"),
        (["start", "--model", "gpt-9"], "smollm2-135m"),
        (["twins", "--world", "nowhere"], "nowhere"),
        (["scale", "--rules", "none.yaml", "--model", "gpt-9"], "gpt-9"),
    ],
)
def test_bad_input_is_told_before_anything_is_measured(
    bench: Measure, words: list[str], says: str
) -> None:
    done = bench(*words)
    assert (done.code, done.out) == (2, "")
    assert says in done.said


def test_bench_without_a_fetched_model_says_how_to_fetch_it_and_measures_the_rest(
    bench: Measure, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    refused = bench()
    assert (refused.code, refused.out) == (2, "")
    assert "pa-console models pull" in refused.said
    done = bench("--only", "rehearsal", "--only", "checks", "--runs", "1")
    assert done.code == 0, done.err
    report = done.figures
    assert (report["model"], report["runs"]) == ("", 1)
    assert report["machine"]["packages"]["pymunk"]
    parts = [line["part"] for line in report["comparisons"]]
    assert parts == ["checks", *["rehearsal"] * 3]
    for line in report["comparisons"]:
        assert line["ours"]["least"] <= line["ours"]["median"] <= line["ours"]["most"]
        assert (line["ratio"] is None) == (line["other"] is None)


def test_bench_shows_the_machine_a_table_a_part_and_what_a_ratio_means(bench: Measure) -> None:
    done = bench("--only", "rehearsal", "--runs", "1")
    assert done.code == 0, done.err
    for words in ("Python 3", "1 alternating runs", "fork", "deepcopy", "ratio: how many"):
        assert words in done.said


def test_an_interrupted_bench_has_shown_what_was_measured(
    bench: Measure, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_bench: Bench) -> list[Comparison]:
        raise KeyboardInterrupt

    parts = [Part("checks", "Checks in CEL", measure_checks),
             Part("rehearsal", "Rehearsal, fork and forecast", interrupted)]  # fmt: skip
    monkeypatch.setattr("tests.benchmarks.speed.speed.PARTS", tuple(parts))
    done = bench("--runs", "1")
    assert done.code == 130
    assert "interrupted" in done.err
    assert "rehearsed plans" in done.out


@pytest.fixture
def no_model(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Let there be a model that nothing is asked of, and an empty cache."""

    def find_model(_: str | None) -> LocalModel:
        return ScriptedEngine([]).model

    monkeypatch.setattr(degradation, "find_model", find_model)
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))


@pytest.mark.usefixtures("no_model")
def test_degradation_runs_only_what_its_file_lacks(
    bench: Measure, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[int] = []

    async def run_once(_site: Site, _engine: MemoEngine, _row: Disturbance, seed: int) -> RunResult:
        ran.append(seed)
        return RUN

    monkeypatch.setattr(degradation, "run_once", run_once)
    path, row = tmp_path / "runs.jsonl", "link loss 0%"
    RunFile(path).add(row, 1, RUN)
    RunFile(path).add("link loss 10%", 0, RUN)
    words = ("degradation", "--only", row, "--runs", "3", "--out", str(path))
    rows = bench(*words).figures
    assert ran == [0, 2]
    assert [(found["condition"], found["runs"], found["passes"]) for found in rows] == [(row, 3, 6)]
    assert sorted(RunFile(path).results(row)) == [0, 1, 2]
    table = bench(*words)
    assert ran == [0, 2]
    assert "asked 0 times" in table.said
