"""A run on disk: everything that is needed to go on, and the weights that a run begins with.

The folder holds `config.json`, `checkpoint.pt`, `log.jsonl` (a line a step), `curve.csv` (a line a
validation) and `earlier.json` (the runs that it began from).
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pa_training.lora.adapter import (
    BASE,
    BASE_SHA256,
    Adapter,
    AdapterFile,
    of_other_rank,
    slots,
)
from pa_training.lora.base import to_halves
from pa_training.lora.config import TrainConfig
from pa_training.lora.shape import Shape
from pa_training.results.lineage import keep_earlier

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


def first_weights(config: TrainConfig, shape: Shape, base_sha256: str) -> list[Tensor] | None:
    """Return what the run of `config` begins with, None for fresh weights.

    Those are the weights at its `start`, and a share of the difference that is its `lesson`. Raises
    ValueError for what cannot be begun from, or OSError.
    """
    if config.start is None:
        if config.lesson is not None:
            raise ValueError("lesson: is added to the weights of an earlier run: set start")
        return None
    weights = start_weights(Path(config.start), config, shape, base_sha256)
    if config.lesson is None:
        return weights
    ends = (Path(config.lesson.before), Path(config.lesson.after))
    before, after = (start_weights(end, config, shape, base_sha256) for end in ends)
    share = config.lesson.share
    return [
        (own + share * (new - old)).detach()
        for own, old, new in zip(weights, before, after, strict=True)
    ]


def start_weights(start: Path, config: TrainConfig, shape: Shape, base_sha256: str) -> list[Tensor]:
    """Return the weights at `start`, a run's folder or an adapter's file, as `Adapter.masters`.

    Weights of another rank or alpha are given the config's (`ranks.py`). `start` has to be of the
    base that is trained, to which `shape` and `base_sha256` belong. Raises ValueError for what
    cannot be begun from, or OSError.
    """
    if not start.exists():
        raise ValueError(f"start: {start}: is not here: name a run's folder or an adapter's file")
    if start.is_dir():
        folder = RunFolder(start)
        earlier, masters = folder.config(), folder.load().masters
        rank, alpha = earlier.rank, earlier.alpha
    else:
        file = AdapterFile.open(start)
        _check(file, config, base_sha256)
        rank, alpha, masters = file.rank, file.alpha, read_masters(file, shape, file.rank)
    own = Adapter(shape, rank, alpha, 0, "cpu").masters
    if [master.shape for master in masters] != [master.shape for master in own]:
        raise ValueError(f"{start}: is of another base than {config.base}")
    if rank > config.rank and config.lesson is not None:
        raise ValueError(
            f"{start}: is of rank {rank}, the run of {config.rank}: a lesson is not added to "
            f"matrices that are cut down: set rank={rank}"
        )
    if (rank, alpha) == (config.rank, config.alpha):
        return masters
    wanted = Adapter(shape, config.rank, config.alpha, config.seed, "cpu")
    of_other_rank(masters, rank, alpha, wanted)
    return [master.detach() for master in wanted.masters]


def read_masters(file: AdapterFile, shape: Shape, rank: int) -> list[Tensor]:
    """Return the matrices in `file` as `Adapter.masters`: the inverse of `export.matrices`.

    Raises ValueError where a tensor is missing, of another shape, or of a layer that is not
    trained.
    """
    masters: list[Tensor] = []
    read = set[str]()
    for layer in range(shape.layers):
        for slot in slots(shape):
            rows_a: list[NDArray[np.float32]] = []
            rows_b: list[NDArray[np.float32]] = []
            for part, outputs in zip(slot.parts, slot.outputs, strict=True):
                name = f"blk.{layer}.{part}.weight"
                a, b = f"{name}.lora_a", f"{name}.lora_b"
                read |= {a, b}
                rows_a.append(file.values(a, (rank, slot.inputs)))
                rows = file.values(b, (outputs, rank))
                heads = shape.paired_heads.get(part)
                rows_b.append(rows if heads is None else to_halves(rows, heads))
            masters += [torch.from_numpy(np.concatenate(rows)) for rows in (rows_a, rows_b)]
    others = file.stored.keys() - read
    if others:
        raise ValueError(f"{file.path}: {min(others)}: is of a layer that is not trained here")
    return masters


def _check(file: AdapterFile, config: TrainConfig, base_sha256: str) -> None:
    """Raise ValueError when the run of `config` cannot go on from `file`."""
    path, own = file.path, file.text(BASE_SHA256)
    if not own:
        raise ValueError(f"{path}: does not say of which base it is: this trainer has not made it")
    if own != base_sha256:
        raise ValueError(
            f"{path}: is an adapter of another base, {file.text(BASE) or 'unnamed'} "
            f"(SHA-256 {own[:12]}), than {config.base} ({base_sha256[:12]}): "
            "set base, or start from another"
        )
    if file.alpha <= 0.0:
        raise ValueError(f"{path}: does not say its alpha: this trainer has not made it")
