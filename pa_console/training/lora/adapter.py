"""The trainable weights: low-rank corrections of every linear layer.

Layers that read the same input are computed as one (q, k and v; gate and up): their A matrices are
stacked and their B matrices stand on the diagonal of one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor

from pa_console.training.lora.shape import Shape


@dataclass(frozen=True)
class Slot:
    """Linear layers that share an input, by llama.cpp's names, with their output widths."""

    parts: tuple[str, ...]
    inputs: int
    outputs: tuple[int, ...]


def slots(shape: Shape) -> tuple[Slot, ...]:
    """Return the four slots of every layer, in the order in which they are computed."""
    return (
        Slot(
            ("attn_q", "attn_k", "attn_v"),
            shape.width,
            (shape.q_width, shape.kv_width, shape.kv_width),
        ),
        Slot(("attn_output",), shape.q_width, (shape.width,)),
        Slot(("ffn_gate", "ffn_up"), shape.width, (shape.hidden, shape.hidden)),
        Slot(("ffn_down",), shape.hidden, (shape.width,)),
    )


@dataclass(frozen=True)
class Pair:
    """What the forward pass multiplies with: A (ranks, inputs) and scaled B (outputs, ranks)."""

    a: Tensor
    b: Tensor


class Adapter:
    """Float32 master weights of a fresh adapter: A random, B zero, so that it changes nothing.

    `masters` holds, layer after layer and slot after slot, A of (rank * parts, inputs) and then B
    of (outputs, rank).
    """

    def __init__(
        self, shape: Shape, rank: int, alpha: float, seed: int, device: str | torch.device
    ) -> None:
        self.rank, self.alpha = rank, alpha
        self.slots = slots(shape) * shape.layers
        generator = torch.Generator().manual_seed(seed)
        self.masters: list[Tensor] = []
        for slot in self.slots:
            bound = slot.inputs**-0.5
            a = torch.rand(rank * len(slot.parts), slot.inputs, generator=generator)
            b = torch.zeros(sum(slot.outputs), rank)
            self.masters += [(a * 2 * bound - bound).to(device), b.to(device)]
        for master in self.masters:
            master.requires_grad_()

    @property
    def size(self) -> int:
        """How many numbers are trained."""
        return sum(master.numel() for master in self.masters)

    def working(self, dtype: torch.dtype) -> list[Pair]:
        """Return copies for the forward pass, leaves of their own graph, one pair a slot."""
        with torch.no_grad():
            scale = self.alpha / self.rank
            pairs: list[Pair] = []
            for slot, a, b in self._each(self.masters):
                blocks = cast(Tensor, torch.block_diag(*torch.split(b, list(slot.outputs)))) * scale
                pairs.append(Pair(a.to(dtype, copy=True), blocks.to(dtype)))
        for pair in pairs:
            pair.a.requires_grad_()
            pair.b.requires_grad_()
        return pairs

    def set_gradients(self, gradients: Sequence[Tensor]) -> None:
        """Give the masters the `gradients` of their working copies (A, B, A, B...)."""
        scale = self.alpha / self.rank
        for number, (slot, a, b) in enumerate(self._each(self.masters)):
            a.grad = gradients[2 * number].float()
            blocks = torch.split(gradients[2 * number + 1], list(slot.outputs))
            kept = [x[:, n * self.rank : (n + 1) * self.rank] for n, x in enumerate(blocks)]
            b.grad = torch.cat(kept).float() * scale

    def _each(self, tensors: Sequence[Tensor]) -> list[tuple[Slot, Tensor, Tensor]]:
        return [(s, tensors[2 * n], tensors[2 * n + 1]) for n, s in enumerate(self.slots)]
