"""The samples that a run learns from, and those that it is validated with."""

from pathlib import Path

import pytest

from pa_console.llm.models.catalogue import LocalModel
from pa_training.adapters.config import TrainConfig
from pa_training.adapters.material import Tokeniser, rows_held_out, rows_to_learn
from pa_training.samples.sample import Sample
from tests.llm.conftest import smallest_model
from tests.training.adapters.sample_files import write_samples

__all__ = ["smallest_model"]


def planned(group: str) -> Sample:
    return Sample(
        group=group,
        system="Plan the mission.",
        picture="EastGate: nobody\n",
        rest='Mission: "go"',
        answer='{"reason": "asked: 1 drone to EastGate; Free drone: Hawk_1", "actions": []}',
        task="planner",
        kind="go/plain",
    )


@pytest.fixture
def file(tmp_path: Path) -> str:
    write_samples(tmp_path / "planner.jsonl", map(planned, "abc"))
    return str(tmp_path / "planner.jsonl")


def test_of_files_only_names_are_kept() -> None:
    config = TrainConfig(task="judge", base="b", data="a/judge.jsonl", start="c/d.gguf")
    kept = config.without_folders()
    assert (kept.data, kept.start) == ("judge.jsonl", "d.gguf")


def test_nothing_is_held_out_unless_it_is_asked_for(file: str, smallest_model: LocalModel) -> None:
    tokeniser = Tokeniser(smallest_model.path, smallest_model.chat)
    config = TrainConfig(task="planner", base="smollm2-135m", data=file)
    assert len(rows_to_learn(config, tokeniser)) == 3
    assert rows_held_out(config, tokeniser) == []


def test_no_more_is_held_out_than_is_looked_at(file: str, smallest_model: LocalModel) -> None:
    tokeniser = Tokeniser(smallest_model.path, smallest_model.chat)
    config = TrainConfig(task="planner", base="b", data="d", validation=file, validation_samples=2)
    assert len(rows_held_out(config, tokeniser)) == 2
