"""Takes a base from float32 to eight bits, by the inputs that its layers meet in a few packs."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import torch

from pa_training.lora.adapter import Adapter
from pa_training.lora.base import Base
from pa_training.lora.frozen import EightBits, Frozen, Measured
from pa_training.lora.model import Batch, hidden
from pa_training.lora.packs import Pack

PACKS = 6
"""That are looked at, from all over the data."""
MATRICES = ("qkv", "output", "gate_up", "down")
"""Of a layer."""


@torch.no_grad()
def in_eight_bits(base: Base, packs: Sequence[Pack]) -> Base:
    """Return `base`, which is exact, with its linear layers in eight bits.

    They are scaled by what the base alone makes of `packs`: the same in every run on these data.
    """
    measured = _changed(base, lambda matrix: Measured(matrix.weight))
    nothing = Adapter(base.shape, 1, 1.0, 0, base.embedding.device).working(base.embedding.dtype)
    for pack in packs[:: max(1, len(packs) // PACKS)][:PACKS]:
        batch = Batch.make(pack, base.embedding.device)
        hidden(measured, nothing, batch.tokens, batch.layout)
    return _changed(measured, EightBits.of)


def _changed(base: Base, change: Callable[[Any], Frozen]) -> Base:
    """Return `base` with every matrix of its layers changed."""
    return replace(
        base,
        layers=tuple(
            replace(layer, **{name: change(getattr(layer, name)) for name in MATRICES})
            for layer in base.layers
        ),
    )
