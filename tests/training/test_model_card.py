"""The model card says where an adapter comes from, and refuses what does not belong together."""

from pathlib import Path
from typing import NamedTuple

import pytest

from pa_console.evaluation.run_record import EvaluationFolder
from pa_training.results.lineage import ADAPTER, EARLIER, EarlierRun, to_json
from pa_training.results.model_card import model_card
from tests.evaluation.records import made_evaluation
from tests.training.finished_run import data_set, finished_run


class Folders(NamedTuple):
    """A run and the data set that it was trained on."""

    run: Path
    data: Path


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    data = data_set(tmp_path / "data")
    return Folders(finished_run(tmp_path / "run", data), data)


def lines(card: str) -> list[str]:
    return card.splitlines()


def test_the_card_tells_data_training_and_what_it_was_kept_apart_from(folders: Folders) -> None:
    card = model_card(*folders, "planner-135m")
    assert card.startswith("# planner-135m\n")
    for row in (
        "| base, SHA-256 | " + "b" * 64 + " |",
        "| samples to train on | planner 2 |",
        "| planner: look | 1 |",
        "| go: checks WF-03 | 4 |",
        "| rank | 16 |",
        "| 100 | 2 | 800 | 1.5 | 1.75 | 0.5 |",
    ):
        assert row in lines(card)
    assert "Apache-2.0" in card
    assert "kept apart from field.yaml" in card
    assert "No evaluation was given" in card


def test_the_card_names_no_folder_of_the_machine(folders: Folders, tmp_path: Path) -> None:
    assert str(tmp_path) not in model_card(*folders, "planner-135m")


def test_figures_come_from_the_runs_of_an_evaluation(folders: Folders, tmp_path: Path) -> None:
    results = EvaluationFolder(tmp_path / "eval")
    records = made_evaluation()
    for record in records:
        results.add(record)
    card = model_card(*folders, "planner-135m", tmp_path / "eval")
    assert "No evaluation was given" not in card
    one = records[0]
    place = one.mission_set, one.model, one.variant
    runs = [r for r in records if (r.mission_set, r.model, r.variant) == place]
    [row] = [line for line in lines(card) if line.startswith(f"| {' | '.join(place)} |")]
    assert f" {sum(run.strict for run in runs)}/{len(runs)} |" in row


def test_another_data_set_than_the_run_had_is_refused(folders: Folders) -> None:
    with (folders.data / "report.json").open("r+") as file:
        text = file.read()
        file.seek(0)
        begin = text.index('"planner.jsonl": "') + len('"planner.jsonl": "')
        file.write(text[:begin] + "0" * 64 + text[begin + 64 :])
    with pytest.raises(ValueError, match="is not the data set that"):
        model_card(*folders, "planner-135m")


def test_an_adapter_that_was_changed_is_refused(folders: Folders) -> None:
    (folders.run / ADAPTER).write_bytes(b"another")
    with pytest.raises(ValueError, match="has changed since the run ended"):
        model_card(*folders, "planner-135m")


def test_a_folder_without_a_run_says_what_to_do(folders: Folders, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"run\.json: there is no such file: run python"):
        model_card(tmp_path, folders.data, "planner-135m")


def test_the_runs_that_it_began_from_are_told(folders: Folders, tmp_path: Path) -> None:
    run = finished_run(tmp_path / "third", folders.data)
    rows = [EarlierRun(name, 3, 16, 8e-4, "800", "2", "1.75", "0.5") for name in ("a", "b")]
    (run / EARLIER).write_text(to_json(rows))
    card = model_card(run, folders.data, "planner-135m")
    told = [row for row in lines(card) if row.startswith(("| a ", "| b "))]
    assert told == [f"| {name} | 3 | 16 | 0.0008 | 800 | 2 | 1.75 | 0.5 |" for name in ("a", "b")]
