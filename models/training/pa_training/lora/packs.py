"""What a step learns from: prefixes of tokens and what continues them.

Needs numpy and nothing else, so that a machine without the console can learn.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Tokens = NDArray[np.int32]


@dataclass(frozen=True)
class Branch:
    """One sample behind the shared prefix.

    `tokens` are the rest of the prompt, then the answer without its last token; `targets` is the
    answer: what the last `len(targets)` of `tokens` are to predict, each with its weight. A
    weight of zero is that of a token which the grammar writes.
    """

    tokens: Tokens
    targets: Tokens
    weights: NDArray[np.float32]


@dataclass(frozen=True)
class Pack:
    """A prefix and the samples that continue it."""

    prefix: Tokens
    branches: tuple[Branch, ...]

    @property
    def size(self) -> int:
        """Tokens that are computed."""
        return len(self.prefix) + sum(len(branch.tokens) for branch in self.branches)

    @property
    def loss_weight(self) -> float:
        """Sum of the weights of all tokens that are to be predicted."""
        return float(sum(branch.weights.sum() for branch in self.branches))
