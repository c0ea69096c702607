"""How one pack of tokens lies in memory: a shared prefix, then branches that continue it.

Linear layers see all tokens in a row; only attention goes branch by branch.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import torch
from torch import Tensor


@dataclass(frozen=True)
class Layout:
    """Where the prefix and the branches of a pack lie."""

    prefix: int
    spans: tuple[tuple[int, int], ...]
    """First token and end of the prefix, then of every branch."""
    positions: Tensor
    """Position in the text of every token of the pack, float32 (tokens)."""
    ahead: Tensor
    """True above the diagonal: what a token may not see of its own span (longest, longest)."""

    def beyond(self, start: int, end: int, window: int) -> Tensor | None:
        """Return which keys each token of the span from `start` to `end` is too far from to see.

        Keys are the prefix and the span itself (tokens, keys); it sees those less than `window`
        positions behind it. None: it sees all that is before it, which a window of 0 means too.
        """
        own = self.positions[start:end]
        if not window or len(own) == 0 or own[-1] < window:
            return None
        keys = torch.cat((self.positions[: self.prefix], own)) if start else own
        return own[:, None] - keys >= window

    @classmethod
    def make(cls, prefix: int, lengths: Sequence[int], device: str | torch.device) -> "Layout":
        """Lay out branches of `lengths` tokens behind `prefix` tokens."""
        longest = max((prefix, *lengths))
        positions = [*range(prefix), *(prefix + t for length in lengths for t in range(length))]
        return cls(
            prefix=prefix,
            spans=tuple(pairwise(accumulate((prefix, *lengths), initial=0))),
            positions=torch.tensor(positions, dtype=torch.float32, device=device),
            ahead=torch.ones(longest, longest, dtype=torch.bool, device=device).triu(1),
        )
