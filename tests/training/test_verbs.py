"""`python -m pa_training`: data gone on with, training runs, mission sets, cards; wrong input."""

import json
import sys
from collections.abc import Callable, Generator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from pa_console.evaluation.jobs import load_with_worlds
from pa_training.adapters.config import TrainConfig, shipped_config
from pa_training.adapters.run_folder import RunFolder
from pa_training.orders.written import Source, Writer, read_writer, writer_names
from pa_training.results import written_missions
from pa_training.results.lineage import ADAPTER, read_summary
from pa_training.samples.data_set import DataFolder, Made
from pa_training.samples.sample import read_samples
from pa_training.situations.worlds import shipped_world
from pa_training.verbs import data as train_data
from pa_training.verbs import run as train_run
from tests.cli.inside import Call
from tests.training.finished_run import data_set, finished_run

SMALL = ("--groups", "1", "--plans", "1", "--jobs", "1")


def test_data_is_made_once_and_gone_on_with(call: Call, tmp_path: Path) -> None:
    out = tmp_path / "data"
    first = call("data", "--out", str(out), *SMALL, "--json")
    assert first.code == 0, first.err
    assert first.json["samples"]["train"]["planner"] > 10
    assert first.json["samples"]["valid"].keys() == {"planner", "judge"}
    assert first.json == json.loads((out / "report.json").read_text())
    before = (out / "planner.jsonl").read_bytes()
    second = call("data", "--out", str(out), *SMALL)
    assert second.code == 0
    assert "there already: 2 groups" in second.said
    assert (out / "planner.jsonl").read_bytes() == before
    assert list(read_samples(out / "planner.jsonl", "planner"))


def test_data_that_is_interrupted_keeps_what_is_whole(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*given: Any) -> Generator[Made, None, None]:
        yield Made(name="a", valid=False, generator="g", samples=(), dropped={})
        raise KeyboardInterrupt

    out = tmp_path / "data"
    monkeypatch.setattr(train_data, "build", interrupted)
    done = call("data", "--out", str(out), *SMALL)
    assert done.code == 130
    assert f"the same command with --out {out} goes on" in done.said
    assert [made.name for made in DataFolder(out).groups()] == ["a"]


@dataclass(frozen=True)
class Step:
    """Where a run stands, as the training loop tells it."""

    step: int
    steps: int = 4
    loss: float = 0.5
    rate: float = 1e-4
    tokens_per_s: float = 1000.0
    minutes: float = 1.5
    validation_loss: float | None = 0.25
    validation_right: float | None = 0.75


@dataclass(frozen=True)
class Result:
    """What a run came to."""

    finished: bool
    last: Step
    adapter_sha256: str = "f" * 64


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Training without a model: a run stops after half of its steps, a resumed one ends."""
    base = tmp_path / "base.gguf"
    base.write_bytes(b"base")

    def train(
        config: TrainConfig, out: Path, resume: bool, on_progress: Callable[[Step], None]
    ) -> Result:
        if not resume:
            RunFolder(out).begin(config, {})
        last = Step(4 if resume else 2)
        on_progress(last)
        (out / ADAPTER).write_bytes(b"adapter")
        return Result(resume, last)

    def found(_: TrainConfig) -> tuple[Path, str]:
        return base, "template"

    trainer = ModuleType("pa_training.adapters.trainer")
    trainer.__dict__["train"] = train
    monkeypatch.setitem(sys.modules, trainer.__name__, trainer)
    monkeypatch.setattr(train_run, "NEEDED", ("pytest",))
    monkeypatch.setattr(train_run, "find_base", found)


@pytest.mark.usefixtures("quick")
def test_a_run_that_is_stopped_is_kept_exported_and_gone_on_with(
    call: Call, tmp_path: Path
) -> None:
    data, out = data_set(tmp_path / "data"), tmp_path / "run"
    asked = ("planner", "--out", str(out))
    first = call(*asked, "--data", str(data), "--set", "rank=4", "--minutes", "9")
    assert first.code == 130
    assert f"python -m pa_training planner --out {out} --resume goes on" in first.said
    assert (out / ADAPTER).is_file()
    assert not read_summary(out).finished
    second = call(*asked, "--resume")
    assert second.code == 0, second.err
    assert "step 4/4 loss 0.500 1000 tokens/s validation 0.250, 75.0% right" in second.said
    summary = read_summary(out)
    assert (summary.finished, summary.step) == (True, 4)
    assert (summary.config.rank, summary.config.max_minutes) == (4, 9.0)
    assert summary.config.data == str(data / "planner.jsonl")
    assert summary.config.validation is None


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "--data is missing"),
        (("--data", "nowhere"), "nowhere/planner.jsonl: there are no samples"),
        (("--data", "DATA", "--set", "rank"), "NAME=VALUE"),
        (("--data", "DATA", "--set", "rank=many"), "--set: rank:"),
        (("--data", "DATA", "--set", "ranks=3"), "known: task, base"),
        (("--data", "DATA", "--config", "judge.yaml"), "this verb trains the planner"),
        (("--data", "DATA", "--resume"), "--data cannot be changed with --resume"),
        (("--resume",), "no training run to go on with"),
    ],
)
@pytest.mark.usefixtures("quick")
def test_what_cannot_be_trained_with_is_said(
    words: tuple[str, ...], says: str, call: Call, tmp_path: Path
) -> None:
    judge = shipped_config("judge")
    places = {"DATA": str(data_set(tmp_path / "data")), "judge.yaml": str(judge)}
    out = tmp_path / "run"
    done = call("planner", "--out", str(out), *(places.get(word, word) for word in words))
    assert done.code == 2
    assert says in done.said
    assert not out.exists()


def test_the_trainer_can_be_imported_where_its_extra_is_installed() -> None:
    for name in train_run.NEEDED:
        pytest.importorskip(name, reason="training, and its tests, need the extra `train`")
    assert callable(import_module("pa_training.adapters.trainer").train)


def test_without_the_extra_the_remedy_is_said(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(train_run, "NEEDED", ("torch_that_is_not_there",))
    done = call("judge", "--out", str(tmp_path / "run"), "--data", str(tmp_path))
    assert done.code == 2
    assert "pip install 'pa-console[train]'" in done.said


def test_missions_are_written_for_evaluations(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(written_missions, "read_writers", one_writer)
    file = tmp_path / "sets" / "my-set.yaml"
    asked = ("missions", "--out", str(file), "--from", "sealed")
    done = call(*asked)
    assert done.code == 0, done.err
    missions, worlds = load_with_worlds(file, shipped_world())
    assert missions.name == "my_set"
    assert f"{len(missions.missions)} missions in" in done.said
    assert len(missions.missions) > 20
    assert {case.world for case in missions.missions} == worlds.keys() - {""}
    again = call(*asked)
    assert again.code == 2
    assert "is there already" in again.said


def one_writer(source: Source) -> dict[str, Writer]:
    """Return the first writer of `source` with the first situation that a mission set can hold."""
    name = writer_names(source)[0]
    writer = read_writer(source, name)
    first = next(each for each in writer.situations if not each.history)
    return {name: writer.model_copy(update={"situations": (first,)})}


def test_a_card_is_written_beside_the_adapter(call: Call, tmp_path: Path) -> None:
    data = data_set(tmp_path / "data")
    run, card = finished_run(tmp_path / "run", data), tmp_path / "models" / "small.md"
    asked = ("card", "--run", str(run), "--data", str(data), "--out", str(card))
    assert call(*asked).code == 0
    assert card.read_text().startswith("# small\n")
    (run / "run.json").unlink()
    done = call(*asked)
    assert done.code == 2
    assert "run python -m pa_training planner or judge" in done.said
