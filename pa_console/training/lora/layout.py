"""How one pack of tokens lies in memory: a shared prefix, then branches that continue it.

Linear layers see all tokens in a row without padding; only attention pads branches to the longest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Layout:
    """Index tensors of a pack with `prefix` tokens and `branches` of at most `longest` tokens."""

    prefix: int
    branches: int
    longest: int
    places: Tensor
    """Row in the padded (branches * longest) of every branch token."""
    positions: Tensor
    """Position in the text of every token of the pack, float32 (tokens)."""
    ahead: Tensor
    """True above the diagonal: what a token may not see (longest, longest) of its own branch."""
    prefix_ahead: Tensor
    """The same within the prefix (prefix, prefix)."""

    @classmethod
    def make(cls, prefix: int, lengths: Sequence[int], device: str | torch.device) -> "Layout":
        """Lay out branches of `lengths` tokens behind `prefix` tokens."""
        longest = max(lengths, default=0)
        places = [n * longest + t for n, length in enumerate(lengths) for t in range(length)]
        positions = [*range(prefix), *(prefix + t for length in lengths for t in range(length))]
        return cls(
            prefix=prefix,
            branches=len(lengths),
            longest=longest,
            places=torch.tensor(places, dtype=torch.long, device=device),
            positions=torch.tensor(positions, dtype=torch.float32, device=device),
            ahead=_ahead(longest, device),
            prefix_ahead=_ahead(prefix, device),
        )


def _ahead(size: int, device: str | torch.device) -> Tensor:
    return torch.ones(size, size, dtype=torch.bool, device=device).triu(1)
