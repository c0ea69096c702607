"""What a retrieval method is: it gives every rule a score for a text, in parts that are shown."""

from typing import Protocol

import numpy as np

from pa_console.policy.postings import Floats

Scores = dict[str, Floats]
"""The parts of a score by name; each has one number for each rule, in the order of the rules."""


class Ranking(Protocol):
    """Scores all rules that it was made for, in their order; higher is better."""

    def scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the score of each rule for `text`, and the parts it is made of."""
        ...


def best(scores: Floats, k: int) -> list[int]:
    """Return the places of the `k` highest scores, best first, equal ones in ascending order."""
    if k <= 0 or not len(scores):
        return []
    if k < len(scores):
        least = np.partition(scores, len(scores) - k)[len(scores) - k]
        places = np.flatnonzero(scores >= least)
    else:
        places = np.arange(len(scores))
    order = np.argsort(-scores[places], kind="stable")
    return places[order[:k]].tolist()
