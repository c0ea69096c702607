"""The weights that a run begins with when it goes on from an earlier one."""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pa_console.training.lora.adapter import Adapter, slots
from pa_console.training.lora.adapter_file import BASE, BASE_SHA256, AdapterFile
from pa_console.training.lora.base import to_halves
from pa_console.training.lora.checkpoint import RunFolder
from pa_console.training.lora.config import TrainConfig
from pa_console.training.lora.ranks import of_other_rank
from pa_console.training.lora.shape import Shape


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
        raise ValueError(
            f"{path}: does not say of which base it is: pa-console train has not made it"
        )
    if own != base_sha256:
        raise ValueError(
            f"{path}: is an adapter of another base, {file.text(BASE) or 'unnamed'} "
            f"(SHA-256 {own[:12]}), than {config.base} ({base_sha256[:12]}): "
            "set base, or start from another"
        )
    if file.alpha <= 0.0:
        raise ValueError(f"{path}: does not say its alpha: pa-console train has not made it")
