"""A run on disk: everything that is needed to go on as if it had never stopped.

The folder holds `config.json`, `checkpoint.pt`, `log.jsonl` (a line a step), `curve.csv` (a line a
validation) and `earlier.json` (the runs that it began from).
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from pa_console.training.lineage import keep_earlier
from pa_console.training.lora.config import TrainConfig

CONFIG, CHECKPOINT, LOG, CURVE = "config.json", "checkpoint.pt", "log.jsonl", "curve.csv"
CURVE_HEAD = "step,minutes,samples,train_loss,validation_loss,validation_right"


@dataclass
class State:
    """Where a run stands; `step` steps are done."""

    masters: list[Tensor]
    optimiser: dict[str, Any]
    step: int = 0
    seconds: float = 0.0
    samples: int = 0
    tokens: int = 0
    base_sha256: str = ""
    data_sha256: str = ""
    missions_sha256: str = ""


class RunFolder:
    """The folder of one run."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def begin(self, config: TrainConfig) -> None:
        """Start a run; raises ValueError when there is one already, or OSError."""
        if (self.path / CHECKPOINT).exists():
            raise ValueError(
                f"{self.path}: holds a training run already; resume it, or name another folder"
            )
        self.path.mkdir(parents=True, exist_ok=True)
        self._write(CONFIG, config.model_dump_json(indent=2) + "\n")
        self._write(LOG, "")
        self._write(CURVE, CURVE_HEAD + "\n")
        keep_earlier(self.path, config)

    def config(self) -> TrainConfig:
        """Return the run's config; raises ValueError when the folder holds no run."""
        path = self.path / CONFIG
        try:
            return TrainConfig.model_validate_json(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ValueError(f"{path}: no training run to go on with: {error}") from error

    def save(self, state: State) -> None:
        """Write the checkpoint; a crash leaves the one before."""
        path = self.path / CHECKPOINT
        partial = path.with_suffix(".partial")
        torch.save({field.name: getattr(state, field.name) for field in fields(state)}, partial)
        os.replace(partial, path)

    def load(self) -> State:
        """Return the last checkpoint; raises ValueError when it cannot be read."""
        path = self.path / CHECKPOINT
        try:
            return State(**torch.load(path, map_location="cpu", weights_only=True))
        except FileNotFoundError as error:
            raise ValueError(f"{path}: there is no checkpoint: start the run anew") from error
        except Exception as error:  # torch raises what it likes
            raise ValueError(f"{path}: not a checkpoint of this program: {error}") from error

    def rewind(self, step: int) -> None:
        """Forget what was logged after `step`: it is going to be done again."""
        lines = (self.path / LOG).read_text(encoding="utf-8").splitlines(keepends=True)
        self._write(LOG, "".join(line for line in lines if json.loads(line)["step"] <= step))
        head, *rows = (self.path / CURVE).read_text(encoding="utf-8").splitlines(keepends=True)
        kept = [row for row in rows if int(row.partition(",")[0]) <= step]
        self._write(CURVE, head + "".join(kept))

    def log(self, entry: Mapping[str, float]) -> None:
        """Append one step to the log."""
        with (self.path / LOG).open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(entry) + "\n")

    def add_to_curve(self, *values: float) -> None:
        """Append one row to the curve, in the order of CURVE_HEAD."""
        with (self.path / CURVE).open("a", encoding="utf-8") as stream:
            stream.write(",".join(f"{value:.6g}" for value in values) + "\n")

    def _write(self, name: str, text: str) -> None:
        partial = self.path / f"{name}.partial"
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, self.path / name)
