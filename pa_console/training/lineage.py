"""The runs that a run began from, one after another: an adapter is what all of them made it."""

import csv
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from pa_console.training.lora.config import TrainConfig

CONFIG, CURVE = "config.json", "curve.csv"


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


def earlier_runs(config: TrainConfig) -> list[EarlierRun]:
    """Return the runs that `config` goes on from, the first of all first.

    The list ends where a folder is gone or not readable: what is not there cannot be told.
    """
    found: list[EarlierRun] = []
    seen: set[Path] = set()
    start = config.start
    while start is not None and Path(start) not in seen:
        folder = Path(start)
        seen.add(folder)
        try:
            made = TrainConfig.model_validate_json((folder / CONFIG).read_bytes())
        except (OSError, ValidationError):
            break
        found.append(_row(folder, made))
        start = made.start
    return found[::-1]


def _row(folder: Path, made: TrainConfig) -> EarlierRun:
    last = last_row(folder / CURVE)
    return EarlierRun(
        folder.name,
        made.seed,
        made.rank,
        made.learning_rate,
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
