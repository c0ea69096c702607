"""Packs as one batch: tokens lie in a row for the linear layers, in a grid for attention."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pa_training.gpu.corpus import Branch, Pack
from pa_training.gpu.flash import Segments

WINDOW = 64
"""Batches that are filled together: packs of like lengths come into the same one."""

EVEN = 16
MOST_BRANCHES = 48


@dataclass(frozen=True)
class Grid:
    """Where the tokens of a batch stand when attention is computed, G packs of B branches.

    Slots name a row of the batch, or its number of rows where nothing stands: `prefix` (G, P),
    `branches` (G, B, T). Masks are True for what is seen: `sees_prefix` (G, P, P), `sees` of
    every branch's tokens (G, B, T, P + T).
    """

    positions: Tensor
    prefix: Tensor
    branches: Tensor
    sees_prefix: Tensor
    sees: Tensor
    near_prefix: Tensor | None
    """The same as `sees_prefix`, and within the window of local layers; None where all is near."""
    near: Tensor | None
    slots: Tensor
    """The row of every slot of `prefix`, then of `branches`."""
    rows: Tensor
    """The slot of every row: it undoes `slots`."""


@dataclass(frozen=True)
class Batch:
    """A batch on the device: `rows` predict `targets`, of which `learnt` count (positions)."""

    tokens: Tensor
    layout: Grid | Segments
    rows: Tensor
    targets: Tensor
    learnt: Tensor
    lengths: tuple[int, ...]
    """Targets of every branch."""

    @property
    def size(self) -> int:
        """Tokens that are computed."""
        return len(self.tokens)


def in_batches(
    packs: Sequence[Pack], most_tokens: int, rng: random.Random, padded: bool = True
) -> Iterator[tuple[Pack, ...]]:
    """Yield every pack once, in batches of at most `most_tokens` where there are several.

    Where batches are `padded`, packs of like lengths come together.
    """
    order = [part for pack in packs for part in alike(pack)] if padded else list(packs)
    rng.shuffle(order)
    each = max(1, round(most_tokens / max(1.0, sum(p.size for p in order) / len(order))))
    for start in range(0, len(order), WINDOW * each):
        part = order[start : start + WINDOW * each]
        if padded:
            part.sort(key=_likeness)
        made: list[tuple[Pack, ...]] = []
        together: list[Pack] = []
        size = 0
        for pack in part:
            if together and size + pack.size > most_tokens:
                made.append(tuple(together))
                together, size = [], 0
            together.append(pack)
            size += pack.size
        made.append(tuple(together))
        rng.shuffle(made)
        yield from made


def alike(pack: Pack) -> Iterator[Pack]:
    """Yield parts of `pack` whose branches are of like lengths: little of a grid is padding."""
    together: list[Branch] = []
    for branch in sorted(pack.branches, key=lambda branch: len(branch.tokens)):
        longest = _even(round(1.2 * len(together[0].tokens))) if together else 0
        if together and (len(branch.tokens) > longest or len(together) == MOST_BRANCHES):
            yield Pack(pack.prefix, tuple(together))
            together = []
        together.append(branch)
    yield Pack(pack.prefix, tuple(together))


def _likeness(pack: Pack) -> tuple[int, int]:
    return len(pack.branches) // 4, pack.longest


def _even(length: int) -> int:
    """Return a length at which matrix products are fast: a multiple of EVEN, not less."""
    return -(-length // EVEN) * EVEN


def make_batch(
    packs: Sequence[Pack], window: int, device: str | torch.device, flash: bool = False
) -> Batch:
    """Lay `packs` out and bring them to `device`, all prefixes first, for one way of attention.

    Local layers see `window` positions, 0 all.
    """
    every = [branch for pack in packs for branch in pack.branches]
    prefixes = np.array([len(pack.prefix) for pack in packs])
    counts = np.array([len(pack.branches) for pack in packs])
    lengths = np.array([len(branch.tokens) for branch in every])
    ends = prefixes.sum() + np.cumsum(lengths)
    tokens = np.concatenate(
        [pack.prefix for pack in packs] + [branch.tokens for branch in every]
    ).astype(np.int64)
    begins = np.concatenate((np.zeros_like(prefixes), np.repeat(prefixes, counts)))
    sizes = np.concatenate((prefixes, lengths))
    positions = np.concatenate([np.arange(a, a + n) for a, n in zip(begins, sizes, strict=True)])
    rows = [
        np.arange(end - len(branch.targets), end) for end, branch in zip(ends, every, strict=True)
    ]

    def sent(array: np.ndarray) -> Tensor:
        host = torch.from_numpy(array)
        if torch.device(device).type == "cuda":
            return host.pin_memory().to(device, non_blocking=True)
        return host

    layout: Grid | Segments
    if flash:
        layout = Segments.of(sent(positions).float(), prefixes, lengths, counts)
    else:
        prefix, branches = _placed(packs, prefixes, ends, len(tokens))
        layout = _grid(sent(positions), sent(prefix), sent(branches), window)
    return Batch(
        tokens=sent(tokens),
        layout=layout,
        rows=sent(np.concatenate(rows)),
        targets=sent(np.concatenate([branch.targets for branch in every]).astype(np.int64)),
        learnt=sent(np.concatenate([branch.learnt for branch in every])),
        lengths=tuple(len(branch.targets) for branch in every),
    )


def _placed(
    packs: Sequence[Pack], prefixes: NDArray[np.int64], ends: NDArray[np.int64], total: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows of prefixes (G, P) and of branches (G, B, T); `total` is nobody's row."""
    most_branches = max(len(pack.branches) for pack in packs)
    longest = _even(max(pack.longest for pack in packs))
    prefix = np.full((len(packs), _even(int(prefixes.max()))), total, np.int64)
    branches = np.full((len(packs), most_branches, longest), total, np.int64)
    begins = np.cumsum(prefixes) - prefixes
    number = 0
    for g, pack in enumerate(packs):
        prefix[g, : prefixes[g]] = np.arange(begins[g], begins[g] + prefixes[g])
        for b, branch in enumerate(pack.branches):
            length = len(branch.tokens)
            branches[g, b, :length] = np.arange(ends[number] - length, ends[number])
            number += 1
    return prefix, branches


def _grid(positions: Tensor, prefix: Tensor, branches: Tensor, window: int) -> Grid:
    total = len(positions)
    there, within = prefix < total, branches < total
    packs, longest = prefix.shape[1], branches.shape[2]
    device = positions.device
    down = torch.ones(packs, packs, dtype=torch.bool, device=device).tril()
    own = torch.ones(longest, longest, dtype=torch.bool, device=device).tril()
    nobody = torch.eye(packs, dtype=torch.bool, device=device)
    sees_prefix = (down & there[:, None, :]) | nobody
    shape = branches.shape
    sees = torch.cat(
        (
            there[:, None, None, :].expand(*shape, packs),
            own & within[:, :, None, :].expand(*shape, longest),
        ),
        -1,
    )
    near_prefix = near = None
    if window and packs + longest > window:
        padded = torch.cat((positions, positions.new_zeros(1)))
        at_prefix, at_branch = padded[prefix], padded[branches]
        near_prefix = sees_prefix & (at_prefix[:, :, None] - at_prefix[:, None, :] < window)
        near_prefix |= nobody
        keys = torch.cat((at_prefix[:, None, :].expand(-1, shape[1], -1), at_branch), -1)
        near = sees & (at_branch[..., None] - keys[:, :, None, :] < window)
        near[..., 0] |= ~near.any(-1)
    slots = torch.cat((prefix.flatten(), branches.flatten()))
    rows = slots.new_empty(total + 1)
    rows[slots] = torch.arange(len(slots), device=device)
    return Grid(
        positions.float(), prefix, branches, sees_prefix, sees, near_prefix, near, slots, rows[:-1]
    )
