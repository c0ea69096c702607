"""The forward pass of a decoder with an adapter over packs, their loss and gradients.

Written by hand: the hub's model classes cannot attend to a prefix that many branches share, and
keep GGUF weights packed (445 tokens/s forward and backward on two cores).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from pa_training.lora.adapter import Pair
from pa_training.lora.attention import Layout, Rotation, attend
from pa_training.lora.base import Base
from pa_training.lora.frozen import Frozen
from pa_training.lora.kernels import adapted, answer_loss, gated, normed, score_answers
from pa_training.lora.packs import Pack
from pa_training.lora.shape import Shape


def hidden(
    base: Base,
    pairs: Sequence[Pair],
    tokens: Tensor,
    layout: Layout | Any,
    gather: Callable[[Tensor, Rotation, Any, Shape, int], Tensor] = attend,
) -> Tensor:
    """Return the normed last hidden states (tokens, width) of a pack; four pairs a layer.

    `gather` is attention over what `layout` lays out, which knows the `positions` of the tokens.
    """
    shape = base.shape
    rotation = Rotation.at(layout.positions, base.frequencies)
    local = Rotation.at(layout.positions, base.local_frequencies) if shape.window else rotation
    epsilon = shape.norm_epsilon
    x = functional.embedding(tokens, base.embedding) * shape.embedding_scale
    for number, layer in enumerate(base.layers):
        qkv, output, gate_up, down = pairs[4 * number : 4 * number + 4]
        window = shape.seen(number)
        h = normed(x, layer.attention_norm, epsilon)
        h = adapted(h, layer.qkv, qkv.a, qkv.b, layer.qkv_bias)
        if layer.head_norms is not None:
            h = _heads_normed(h, layer.head_norms, shape)
        h = gather(h, local if window else rotation, layout, shape, window)
        x = _added(x, h, layer.output, output, layer.output_norm, epsilon)
        h = normed(x, layer.hidden_norm, epsilon)
        h = gated(adapted(h, layer.gate_up, gate_up.a, gate_up.b), shape.activation)
        x = _added(x, h, layer.down, down, layer.down_norm, epsilon)
    return normed(x, base.norm, epsilon)


def _added(  # noqa: PLR0917
    x: Tensor, h: Tensor, weight: Frozen, pair: Pair, norm: Tensor | None, epsilon: float
) -> Tensor:
    """Return `x` plus what a linear layer makes of `h`, normed first where there is a `norm`."""
    if norm is None:
        return adapted(h, weight, pair.a, pair.b, x)
    return x + normed(adapted(h, weight, pair.a, pair.b), norm, epsilon)


def _heads_normed(qkv: Tensor, norms: tuple[Tensor, Tensor], shape: Shape) -> Tensor:
    """Return `qkv` (tokens, q, k and v) with every head of q and k normed."""
    q, k, v = torch.split(qkv, [shape.q_width, shape.kv_width, shape.kv_width], 1)
    heads = (part.reshape(-1, shape.head_width) for part in (q, k))
    q, k = (normed(x, n, shape.norm_epsilon) for x, n in zip(heads, norms, strict=True))
    return torch.cat((q.view(len(v), -1), k.view(len(v), -1), v), 1)


@dataclass(frozen=True)
class Batch:
    """One pack on the device; `rows` are the tokens that predict `targets` (positions)."""

    tokens: Tensor
    layout: Layout
    rows: Tensor
    targets: Tensor
    weights: Tensor
    lengths: tuple[int, ...]
    """How many of `rows` belong to each branch."""

    @classmethod
    def make(cls, pack: Pack, device: torch.device) -> "Batch":
        """Bring `pack` to `device`."""
        start, rows = len(pack.prefix), list[int]()
        for branch in pack.branches:
            start += len(branch.tokens)
            rows += range(start - len(branch.targets), start)
        lengths = tuple(len(branch.targets) for branch in pack.branches)
        tokens = np.concatenate([pack.prefix, *(branch.tokens for branch in pack.branches)])
        targets = np.concatenate([branch.targets for branch in pack.branches])
        weights = np.concatenate([branch.weights for branch in pack.branches])
        return cls(
            tokens=torch.from_numpy(tokens).long().to(device),
            layout=Layout.make(len(pack.prefix), [len(b.tokens) for b in pack.branches], device),
            rows=torch.tensor(rows, device=device),
            targets=torch.from_numpy(targets).long().to(device),
            weights=torch.from_numpy(weights).to(device),
            lengths=lengths,
        )


def gradients(
    base: Base, pairs: Sequence[Pair], pack: Pack, total_weight: float
) -> tuple[float, list[Tensor]]:
    """Return the pack's share of the loss and the gradients of `pairs` (A, B, A, B...).

    Shares add up to the mean over all predicted tokens of a step, whose weights sum up to
    `total_weight`.
    """
    batch = Batch.make(pack, base.embedding.device)
    states = hidden(base, pairs, batch.tokens, batch.layout).index_select(0, batch.rows)
    loss = answer_loss(states, base.head, batch.targets, batch.weights / total_weight)
    leaves = [x for pair in pairs for x in (pair.a, pair.b)]
    return loss.item(), list(torch.autograd.grad(loss, leaves))


@dataclass(frozen=True)
class Score:
    """How well answers are predicted: sums, so that packs can be added."""

    samples: int = 0
    tokens: int = 0
    loss: float = 0.0
    right: int = 0
    """Samples each of whose tokens is the most likely one: greedy decoding writes them."""

    def __add__(self, other: "Score") -> "Score":
        return Score(
            self.samples + other.samples,
            self.tokens + other.tokens,
            self.loss + other.loss,
            self.right + other.right,
        )


@torch.no_grad()
def score(base: Base, pairs: Sequence[Pair], pack: Pack) -> Score:
    """Return how well the answers of `pack` are predicted, but for what a grammar writes."""
    batch = Batch.make(pack, base.embedding.device)
    states = hidden(base, pairs, batch.tokens, batch.layout).index_select(0, batch.rows)
    losses, hits = score_answers(states, base.head, batch.targets)
    learnt = batch.weights > 0
    right = sum(bool(part.all()) for part in torch.split(hits | ~learnt, list(batch.lengths)))
    loss = losses[learnt].sum().item()
    return Score(len(batch.lengths), int(learnt.sum().item()), loss, right)
