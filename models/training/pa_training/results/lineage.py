"""The end of a training run, and the runs that it began from, one after another."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError

from pa_console.schema.base import StrictModel
from pa_training.adapters.adapter_file import EARLIER as EARLIER_KEY
from pa_training.adapters.adapter_file import AdapterFile
from pa_training.adapters.config import TrainConfig

SUMMARY, ADAPTER = "run.json", "adapter.gguf"
CONFIG, CURVE, EARLIER = "config.json", "curve.csv", "earlier.json"
Model = TypeVar("Model", bound=BaseModel)


def read_json(path: Path, model: type[Model], remedy: str) -> Model:
    """Return the JSON file at `path` as `model`.

    Raises ValueError naming file and field, with the `remedy` where there is no file.
    """
    try:
        return model.model_validate_json(path.read_bytes())
    except FileNotFoundError as error:
        raise ValueError(f"{path}: there is no such file: {remedy}") from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ValueError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error


class RunSummary(StrictModel):
    """A run after its last step; not `finished` when it was stopped and can be gone on with."""

    config: TrainConfig
    finished: bool
    step: int
    steps: int
    minutes: float
    validation_loss: float | None
    validation_right: float | None
    base_sha256: str
    data_sha256: str
    adapter_sha256: str
    versions: dict[str, str]
    machine: tuple[str, ...]


def write_summary(run: Path, summary: RunSummary) -> None:
    """Write `summary` into the folder `run`; raises OSError."""
    (run / SUMMARY).write_text(summary.model_dump_json(indent=2) + "\n", encoding="utf-8")


def read_summary(run: Path) -> RunSummary:
    """Return the summary in the folder `run`; raises ValueError when there is none."""
    return read_json(run / SUMMARY, RunSummary, "run python -m pa_training planner or judge")


class EarlierRun(NamedTuple):
    """One run: its last row of the curve, as text; empty where there is none."""

    name: str
    seed: int
    rank: int
    learning_rate: float
    samples: str
    minutes: str
    validation_loss: str
    validation_right: str


def earlier_runs(config: TrainConfig) -> list[EarlierRun]:
    """Return the runs that `config` goes on from, the first of all first.

    The adapter at its start tells of them: an adapter that does not, or is not readable, has none.
    """
    if config.start is None:
        return []
    start = Path(config.start)
    try:
        file = AdapterFile.open(start / ADAPTER if start.is_dir() else start)
        return _RUNS.validate_json(file.text(EARLIER_KEY))
    except (OSError, ValueError):
        return []


def keep_earlier(folder: Path, config: TrainConfig) -> None:
    """Write `earlier_runs` into the run's `folder`: its start may change; raises OSError."""
    (folder / EARLIER).write_text(to_json(earlier_runs(config)) + "\n", encoding="utf-8")


def kept_earlier(folder: Path) -> list[EarlierRun]:
    """Return the earlier runs that the run's `folder` keeps, none where it keeps nothing."""
    try:
        return _RUNS.validate_json((folder / EARLIER).read_bytes())
    except (OSError, ValidationError):
        return []


def run_row(folder: Path, config: TrainConfig) -> EarlierRun:
    """Return the row of the run in `folder` itself; of its place only the bare name."""
    rows = curve_rows(folder / CURVE)
    last = rows[-1] if rows else {}
    return EarlierRun(
        folder.resolve().name,
        config.seed,
        config.rank,
        config.learning_rate,
        *(last.get(name, "") for name in EarlierRun._fields[4:]),
    )


def curve_rows(curve: Path) -> list[dict[str, str]]:
    """Return the rows of a validation curve, none where there is no curve."""
    if not curve.exists():
        return []
    with curve.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def to_json(runs: Sequence[EarlierRun]) -> str:
    """Return `runs` as a list of objects, as `earlier.json` and adapters hold them."""
    return json.dumps([run._asdict() for run in runs])


_RUNS = TypeAdapter(list[EarlierRun])
