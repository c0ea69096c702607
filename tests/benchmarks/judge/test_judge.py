"""The benchmark `judge`: what it prints, keeps and refuses."""

import asyncio
import shutil
from pathlib import Path

import pytest

from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.run_record import EvaluationFolder
from pa_console.evaluation.runner import Runner
from pa_console.llm.local.engine import Engine, OnState
from pa_console.llm.models.catalogue import LocalModel
from pa_console.station.assembly import load_site
from pa_console.terminal.output import out
from tests.benchmarks.conftest import Measure
from tests.benchmarks.judge import judge
from tests.evaluation.test_runner import SEND, SPARE, jobs
from tests.scripted import FAILURE, ScriptedEngine


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make an evaluation of one mission by a scripted planner and return its folder."""
    folder = tmp_path_factory.mktemp("evaluation")
    engine = MemoEngine(ScriptedEngine([SPARE]).engine(), reuse=False)
    runner = Runner(EvaluationFolder(folder), lambda _model, _lane: engine)

    async def make() -> None:
        async for _ in runner.run(jobs(load_site("checkpoint", "checkpoint"), SEND)):
            pass

    asyncio.run(make())
    return folder


@pytest.fixture
def runs(evaluation: Path, tmp_path: Path) -> Path:
    """Return a copy of the evaluation."""
    return shutil.copytree(evaluation, tmp_path / "runs")


@pytest.fixture
def strict_judge(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the judge under test be one that objects to everything."""

    def find_model(_: str | None) -> LocalModel:
        return LocalModel("objector", Path("/dev/null"), "1" * 64)

    def engine(_model: LocalModel, _on_state: OnState) -> Engine:
        return ScriptedEngine([], [FAILURE]).engine()

    monkeypatch.setattr(judge, "find_model", find_model)
    monkeypatch.setattr(judge, "Engine", engine)


@pytest.mark.usefixtures("strict_judge")
def test_verdicts_are_told_against_the_truth_and_kept(
    bench: Measure, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(out, "width", 80)
    words = ("judge", str(runs), "--out", str(runs / "answers"))
    report = bench(*words).figures
    assert (report["model"], report["asked"], report["reused"]) == ("objector", 2, 0)
    assert (report["planners"], report["own_plans"]) == (["scripted"], 0)
    assert [(line["name"], line["fn"]) for line in report["total"][:2]] == [
        ("plan", 1), ("outcome", 1),
    ]  # fmt: skip
    assert report["runs"][0]["plan"]["feedback"] == "wrong gate"
    again = bench(*words)
    assert again.code == 0, again.err
    assert "asked 0 times, 2 prompts came again" in again.said
    assert "1/1 scripted/one-plan/test/C1/0: Failure, in truth Success" in again.said
    assert max(map(len, again.out.splitlines()[:20])) <= 80


@pytest.mark.usefixtures("strict_judge")
def test_the_outcome_need_not_be_asked_about(bench: Measure, runs: Path) -> None:
    report = bench("judge", str(runs), "--no-outcome").figures
    assert report["asked"] == 1
    assert report["runs"][0]["outcome"] is None


def test_a_model_that_cannot_be_loaded_is_an_error_and_no_finding(
    bench: Measure, runs: Path
) -> None:
    path = runs / "broken.gguf"
    path.write_bytes(b"not a model at all")
    done = bench("judge", str(runs), "--model", str(path))
    assert (done.code, done.out) == (2, "")
    assert "broken" in done.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--variant", "ful"], "there is: one-plan"),
        (["--planner", "gpt-9"], "there is: scripted"),
        (["--every", "0"], "--every"),
        (["--model", "gpt-9"], "smollm2-135m"),
        (["--rules", "nowhere"], "--rules"),
    ],
)
def test_wrong_words_are_refused(bench: Measure, runs: Path, words: list[str], says: str) -> None:
    done = bench("judge", str(runs), *words)
    assert (done.code, done.out) == (2, "")
    assert says in done.said


@pytest.mark.usefixtures("strict_judge")
def test_a_folder_without_cases_is_refused_with_the_reasons(
    bench: Measure, runs: Path, tmp_path: Path
) -> None:
    for log in (runs / "logs").iterdir():
        log.unlink()
    done = bench("judge", str(runs))
    assert done.code == 2
    assert "left out: 1 (its log is not there)" in done.said
    nowhere = bench("judge", str(tmp_path / "nowhere"))
    assert "there is no such folder" in nowhere.said
