"""The folder of a training run: enough to resume it and to write its model card.

The folder holds `config.json`, `inputs.json` (hashes of base and data), `curve.csv` (a line a
validation), `earlier.json` (the runs that it began from), `checkpoint-N` and, when the run has
ended or was stopped, `adapter.gguf`.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path

from pa_training.adapters.config import TrainConfig
from pa_training.results.lineage import CONFIG, CURVE, keep_earlier

INPUTS = "inputs.json"
CURVE_HEAD = "step,minutes,samples,train_loss,validation_loss,validation_right"


class RunFolder:
    """The folder of one run."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def begin(self, config: TrainConfig, inputs: Mapping[str, str]) -> None:
        """Start a run on `inputs`; raises ValueError when there is one already, or OSError."""
        if self.checkpoint is not None:
            raise ValueError(
                f"{self.path}: holds a training run already; resume it, or name another folder"
            )
        self.path.mkdir(parents=True, exist_ok=True)
        self._write(CONFIG, config.model_dump_json(indent=2) + "\n")
        self._write(INPUTS, json.dumps(inputs, indent=2) + "\n")
        self._write(CURVE, CURVE_HEAD + "\n")
        keep_earlier(self.path, config)

    def config(self) -> TrainConfig:
        """Return the run's config; raises ValueError when the folder holds no run."""
        path = self.path / CONFIG
        try:
            return TrainConfig.model_validate_json(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ValueError(f"{path}: no training run to go on with: {error}") from error

    @property
    def checkpoint(self) -> Path | None:
        """The last checkpoint, None where there is none."""
        found = self.path.glob("checkpoint-*/trainer_state.json")
        return max((file.parent for file in found), key=_step, default=None)

    def go_on(self, inputs: Mapping[str, str]) -> Path:
        """Return the checkpoint to go on from; forget what was noted after it.

        Raises ValueError when there is none, or when the run was begun on other `inputs`.
        """
        checkpoint = self.checkpoint
        if checkpoint is None:
            raise ValueError(f"{self.path}: there is no checkpoint: start the run anew")
        if json.loads((self.path / INPUTS).read_text(encoding="utf-8")) != inputs:
            raise ValueError(
                f"{self.path}: base or data changed since the run began: start it anew"
            )
        head, *rows = (self.path / CURVE).read_text(encoding="utf-8").splitlines(keepends=True)
        kept = [row for row in rows if int(row.partition(",")[0]) <= _step(checkpoint)]
        self._write(CURVE, head + "".join(kept))
        return checkpoint

    def add_to_curve(self, *values: float) -> None:
        """Append one row to the curve, in the order of CURVE_HEAD."""
        with (self.path / CURVE).open("a", encoding="utf-8") as stream:
            stream.write(",".join(f"{value:.6g}" for value in values) + "\n")

    def _write(self, name: str, text: str) -> None:
        partial = self.path / f"{name}.partial"
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, self.path / name)


def _step(checkpoint: Path) -> int:
    return int(checkpoint.name.partition("-")[2])
