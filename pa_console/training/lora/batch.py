"""A pack as tensors, its loss and its gradients."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from pa_console.training.lora.adapter import Pair
from pa_console.training.lora.base import Base
from pa_console.training.lora.kernels import answer_loss, score_answers
from pa_console.training.lora.layout import Layout
from pa_console.training.lora.model import hidden
from pa_console.training.lora.tokens import Pack


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
