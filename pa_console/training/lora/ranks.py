"""Gives an adapter's matrices another rank or alpha: it corrects the base by the same.

A lower rank keeps what it can: the nearest correction of that rank in the sum of squares (Eckart
and Young 1936).
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from pa_console.training.lora.adapter import Adapter


def of_other_rank(masters: Sequence[Tensor], rank: int, alpha: float, wanted: Adapter) -> None:
    """Write to the masters of `wanted` what `masters`, of `rank` and `alpha`, correct.

    `wanted` is fresh: where it is of a higher rank, its further rows are left as they are.
    """
    kept = min(rank, wanted.rank)
    scale = (alpha / rank) / (wanted.alpha / wanted.rank)
    with torch.no_grad():
        for number, slot in enumerate(wanted.slots):
            parts = len(slot.parts)
            new_a, new_b = wanted.masters[2 * number : 2 * number + 2]
            a = masters[2 * number].view(parts, rank, slot.inputs)
            b = torch.split(masters[2 * number + 1] * scale, list(slot.outputs))
            pairs = [_nearest(*pair, kept) for pair in zip(a, b, strict=True)]
            new_a.view(parts, wanted.rank, -1)[:, :kept] = torch.stack([a for a, _ in pairs])
            new_b[:, :kept] = torch.cat([b for _, b in pairs])


def _nearest(a: Tensor, b: Tensor, rank: int) -> tuple[Tensor, Tensor]:
    """Return matrices of `rank` whose product b a is the nearest to that of A and B."""
    if rank == a.shape[0]:
        return a, b
    basis_a, small_a = torch.linalg.qr(a.T)
    basis_b, small_b = torch.linalg.qr(b)
    left, sizes, right = torch.linalg.svd(small_b @ small_a.T)
    roots = sizes[:rank].sqrt()
    return (roots[:, None] * right[:rank]) @ basis_a.T, basis_b @ (left[:, :rank] * roots)
