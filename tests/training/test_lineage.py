"""A run keeps which runs it began from; of their places only the bare names are told."""

from pathlib import Path

import pytest

from pa_training.adapters.config import TrainConfig
from pa_training.results.lineage import earlier_runs, keep_earlier, kept_earlier
from tests.training.finished_run import CURVE


def begin(folder: Path, seed: int, start: Path | None = None) -> TrainConfig:
    """Leave in `folder` what a run leaves there that its followers look at."""
    place = None if start is None else str(start)
    config = TrainConfig(task="planner", base="b", data="d.jsonl", seed=seed, start=place)
    folder.mkdir()
    (folder / "config.json").write_text(config.model_dump_json())
    (folder / "curve.csv").write_text(CURVE)
    keep_earlier(folder, config)
    return config


@pytest.mark.parametrize("start", ["models/planner.lora.gguf", "/home/me/planner.lora.gguf"])
def test_of_the_file_that_a_run_begins_from_only_the_name_is_told(start: str) -> None:
    config = TrainConfig(task="planner", base="b", data="d.jsonl", start=start)
    assert config.without_folders().start == "planner.lora.gguf"


def test_a_run_tells_those_before_it_when_their_folders_are_gone(tmp_path: Path) -> None:
    first, second, third = (tmp_path / name for name in ("first", "second", "third"))
    begin(first, 1)
    begin(second, 2, first)
    config = begin(third, 3, second)
    found = earlier_runs(config)
    assert [(row.name, row.seed, row.samples) for row in found] == [
        ("first", 1, "800"),
        ("second", 2, "800"),
    ]
    for folder in (first, second):
        folder.rename(tmp_path / f"moved-{folder.name}")
    assert earlier_runs(config) == []
    assert kept_earlier(third, config) == found
    follower = config.model_copy(update={"start": str(third)})
    assert [row.name for row in earlier_runs(follower)] == ["first", "second", "third"]


@pytest.mark.parametrize("broken", ["", "[{}]", '[{"name": "first"}]'])
def test_where_nothing_readable_was_kept_the_folders_tell(broken: str, tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    begin(first, 1)
    config = begin(second, 2, first)
    (second / "earlier.json").write_text(broken)
    assert [row.name for row in kept_earlier(second, config)] == ["first"]
