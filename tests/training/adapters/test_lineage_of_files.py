"""An adapter's file tells which runs it went through, without their folders."""

import shutil
from pathlib import Path

from pa_training.adapters.adapter_file import EARLIER, AdapterFile
from pa_training.adapters.trainer import train
from pa_training.results.lineage import (
    ADAPTER,
    CURVE,
    curve_rows,
    earlier_runs,
    kept_earlier,
)
from tests.training.adapters.small_run import config, ignore


def run(tiny: Path, data: Path, out: Path, start: Path | None, seed: int) -> Path:
    """Train a step into `out` and return the file that it was exported to."""
    chosen = config(
        tiny,
        data,
        start=None if start is None else str(start),
        seed=seed,
        steps=1,
        validate_every=1,
    )
    train(chosen, out, False, ignore)
    file = out.parent / f"{out.name}.gguf"
    shutil.copy(out / ADAPTER, file)
    return file


def test_a_file_tells_the_runs_before_it_and_its_own(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    first, second, third = (tmp_path / name for name in ("first", "second", "third"))
    run(tiny, data, first, None, 1)
    file = run(tiny, data, second, run(tiny, data, tmp_path / "other", first, 2), 3)
    *_, last = curve_rows(second / CURVE)
    for folder in (first, tmp_path / "other", second):
        shutil.rmtree(folder)
    found = earlier_runs(config(tiny, data, start=str(file)))
    assert [(row.name, row.seed) for row in found] == [("first", 1), ("other", 2), ("second", 3)]
    assert found[-1].validation_loss == last["validation_loss"] != ""
    assert str(tmp_path) not in AdapterFile.open(file).text(EARLIER)
    run(tiny, data, third, file, 4)
    file.unlink()
    assert kept_earlier(third) == found
    after = earlier_runs(config(tiny, data, start=str(third)))
    assert [row.name for row in after] == ["first", "other", "second", "third"]


def test_a_run_that_replaces_the_file_it_began_from_is_not_before_itself(
    tiny: Path, data: Path, tmp_path: Path
) -> None:
    file = run(tiny, data, tmp_path / "first", None, 1)
    run(tiny, data, tmp_path / "second", file, 2)
    for _ in range(2):
        shutil.copy(tmp_path / "second" / ADAPTER, file)
        found = earlier_runs(config(tiny, data, start=str(file)))
        assert [row.name for row in found] == ["first", "second"]


def test_a_file_that_is_no_adapter_tells_nothing(tiny: Path, data: Path) -> None:
    for file in (tiny, data):
        assert earlier_runs(config(tiny, data, start=str(file))) == []
