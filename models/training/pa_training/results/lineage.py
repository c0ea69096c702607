"""What a training run came to, and the runs that it began from, one after another."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError

from pa_console.schema.base import StrictModel
from pa_training.adapters.adapter_file import CONFIG as CONFIG_KEY
from pa_training.adapters.adapter_file import EARLIER as EARLIER_KEY
from pa_training.adapters.adapter_file import SAMPLES, AdapterFile
from pa_training.adapters.config import TrainConfig

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


SUMMARY, ADAPTER = "run.json", "adapter.gguf"


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


CONFIG, CURVE, EARLIER = "config.json", "curve.csv", "earlier.json"


class EarlierRun(NamedTuple):
    """One earlier run: its last row of the curve, as text; empty where there is none."""

    name: str
    seed: int
    rank: int
    learning_rate: float
    samples: str
    minutes: str
    validation_loss: str
    validation_right: str


_RUNS = TypeAdapter(list[EarlierRun])


def earlier_runs(config: TrainConfig) -> list[EarlierRun]:
    """Return the runs that `config` goes on from, the first of all first.

    A run's folder and an adapter's file know those before them. The list begins after what is gone
    or not readable: what is not there cannot be told.
    """
    found: list[EarlierRun] = []
    seen: set[Path] = set()
    start = config.start
    while start is not None and Path(start) not in seen:
        place = Path(start)
        seen.add(place)
        if place.is_file():
            return _runs_of_file(place) + found[::-1]
        try:
            made = TrainConfig.model_validate_json((place / CONFIG).read_bytes())
        except (OSError, ValidationError):
            break
        found.append(run_row(place, made))
        kept = _kept(place)
        if kept is not None:
            return kept + found[::-1]
        start = made.start
    return found[::-1]


def keep_earlier(folder: Path, config: TrainConfig) -> None:
    """Write `earlier_runs` into the run's `folder`: what it begins from may change; OSError."""
    (folder / EARLIER).write_text(to_json(earlier_runs(config)) + "\n", encoding="utf-8")


def kept_earlier(folder: Path, config: TrainConfig) -> list[EarlierRun]:
    """Return what the run's `folder` keeps, or else `earlier_runs`."""
    kept = _kept(folder)
    return earlier_runs(config) if kept is None else kept


def run_row(folder: Path, config: TrainConfig) -> EarlierRun:
    """Return the row of the run in `folder` itself; of its place only the bare name."""
    last = last_row(folder / CURVE)
    return EarlierRun(
        folder.resolve().name,
        config.seed,
        config.rank,
        config.learning_rate,
        last.get("samples", ""),
        last.get("minutes", ""),
        last.get("validation_loss", ""),
        last.get("validation_right", ""),
    )


def last_row(curve: Path) -> dict[str, str]:
    """Return the last row of a validation curve, nothing where there is no curve."""
    if not curve.exists():
        return {}
    with curve.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    return rows[-1] if rows else {}


def to_json(runs: Sequence[EarlierRun]) -> str:
    """Return `runs` as a list of objects, as `earlier.json` and adapters hold them."""
    return json.dumps([run._asdict() for run in runs])


def _kept(folder: Path) -> list[EarlierRun] | None:
    try:
        return _RUNS.validate_json((folder / EARLIER).read_bytes())
    except (OSError, ValidationError):
        return None


def _runs_of_file(path: Path) -> list[EarlierRun]:
    """Return the runs that an adapter's file tells of, its own the last; none where it does not."""
    try:
        file = AdapterFile.open(path)
        if EARLIER_KEY in file.metadata:
            return _RUNS.validate_json(file.text(EARLIER_KEY))
        made = _Made.model_validate_json(file.text(CONFIG_KEY))
    except (OSError, ValueError):
        return []
    samples = file.text(SAMPLES)
    return [EarlierRun(path.name, made.seed, made.rank, made.learning_rate, samples, "", "", "")]


class _Made(BaseModel):
    """What a table has of a run's config, whichever version of the trainer it is from."""

    seed: int
    rank: int
    learning_rate: float
