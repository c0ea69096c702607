"""The weights that a run begins with: fresh ones, or those of an earlier run."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pa_training.adapters.adapter_file import (
    BASE,
    BASE_SHA256,
    REMEDY,
    AdapterFile,
    Array,
    Matrices,
)
from pa_training.adapters.config import TrainConfig
from pa_training.results.lineage import ADAPTER


def first_matrices(
    config: TrainConfig, fresh: Matrices, paired_heads: Mapping[str, int], base_sha256: str
) -> Matrices:
    """Return `fresh` weights, or those at the `start` of `config`, at its rank.

    The start is a run's folder or an adapter's file; it has to be of the base that is trained, to
    which `fresh` weights and `base_sha256` belong. Raises ValueError for a start that is not, or
    OSError.
    """
    if config.start is None:
        return fresh
    start = Path(config.start)
    path = start / ADAPTER if start.is_dir() else start
    if not path.exists():
        raise ValueError(f"start: {path}: is not here: name a run's folder or an adapter's file")
    file = AdapterFile.open(path)
    _check(file, config, base_sha256)
    matrices = file.matrices(paired_heads)
    _check_layers(path, matrices, fresh)
    rank = len(next(iter(matrices.values()))[0])
    scale = (file.alpha / rank) / (config.alpha / config.rank)
    return {
        layer: _of_rank(a, b * np.float32(scale), fresh[layer])
        for layer, (a, b) in matrices.items()
    }


def _of_rank(a: Array, b: Array, fresh: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return A and B at the rank of `fresh`, with the same product b a or the nearest to it.

    The further rows of a higher rank are those of `fresh`, which change nothing.
    """
    rank, wanted = len(a), len(fresh[0])
    if wanted >= rank:
        return np.vstack((a, fresh[0][rank:])), np.hstack((b, fresh[1][:, rank:]))
    basis_a, small_a = np.linalg.qr(a.T)
    basis_b, small_b = np.linalg.qr(b)
    left, sizes, right = np.linalg.svd(small_b @ small_a.T)
    roots = np.sqrt(sizes[:wanted])
    return (roots[:, None] * right[:wanted]) @ basis_a.T, basis_b @ (left[:, :wanted] * roots)


def _check(file: AdapterFile, config: TrainConfig, base_sha256: str) -> None:
    """Raise ValueError when the run of `config` cannot go on from `file`."""
    path, own = file.path, file.text(BASE_SHA256)
    if not own:
        raise ValueError(f"{path}: does not say of which base it is: {REMEDY}")
    if own != base_sha256:
        raise ValueError(
            f"{path}: is an adapter of another base, {file.text(BASE) or 'unnamed'} "
            f"(SHA-256 {own[:12]}), than {config.base} ({base_sha256[:12]}): "
            "set base, or start from another"
        )
    if file.alpha <= 0.0:
        raise ValueError(f"{path}: does not say its alpha: {REMEDY}")


def _check_layers(path: Path, matrices: Matrices, fresh: Matrices) -> None:
    """Raise ValueError where `matrices` are not those of the layers of `fresh`."""
    if missing := fresh.keys() - matrices.keys():
        raise ValueError(f"{path}: tensor {min(missing)}.weight.lora_a is missing: {REMEDY}")
    if others := matrices.keys() - fresh.keys():
        raise ValueError(f"{path}: {min(others)}: is of a layer that is not trained here")
    for layer, (a, b) in matrices.items():
        wanted = fresh[layer][1].shape[0], fresh[layer][0].shape[1]
        if (found := (b.shape[0], a.shape[1])) != wanted:
            raise ValueError(f"{path}: {layer}: is of {found}, not of {wanted}: {REMEDY}")
