"""What a run learns from: its own samples, and for a judge the missions that it reads as well."""

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


def judged(group: str) -> Sample:
    return planned(group).model_copy(update={"task": "judge", "answer": '{"feedback": "fine"}'})


@pytest.fixture
def files(tmp_path: Path) -> dict[str, str]:
    write_samples(tmp_path / "planner.jsonl", map(planned, "abc"))
    write_samples(tmp_path / "judge.jsonl", map(judged, "de"))
    return {name: str(tmp_path / f"{name}.jsonl") for name in ("planner", "judge")}


def test_a_judge_learns_to_read_missions_beside_its_own_samples(
    files: dict[str, str], smallest_model: LocalModel
) -> None:
    tokeniser = Tokeniser(smallest_model.path, smallest_model.chat)
    config = TrainConfig(
        task="judge", base="smollm2-135m", data=files["judge"], validation=files["judge"]
    )
    assert len(rows_to_learn(config, tokeniser)) == 2
    both = config.model_copy(update={"missions": files["planner"]})
    assert len(rows_to_learn(both, tokeniser)) == 5
    assert len(rows_held_out(both, tokeniser)) == 2


def test_a_planner_learns_its_own_samples_only(
    files: dict[str, str], smallest_model: LocalModel
) -> None:
    tokeniser = Tokeniser(smallest_model.path, smallest_model.chat)
    config = TrainConfig(
        task="planner", base="smollm2-135m", data=files["planner"], missions=files["planner"]
    )
    assert len(rows_to_learn(config, tokeniser)) == 3
    assert rows_held_out(config, tokeniser) == []


def test_of_files_only_names_are_kept() -> None:
    config = TrainConfig(task="judge", base="b", data="a/judge.jsonl", missions="a/planner.jsonl")
    kept = config.without_folders()
    assert (kept.data, kept.missions) == ("judge.jsonl", "planner.jsonl")


def test_no_more_is_held_out_than_is_looked_at(
    files: dict[str, str], smallest_model: LocalModel
) -> None:
    tokeniser = Tokeniser(smallest_model.path, smallest_model.chat)
    config = TrainConfig(
        task="planner", base="b", data="d", validation=files["planner"], validation_samples=2
    )
    assert len(rows_held_out(config, tokeniser)) == 2
