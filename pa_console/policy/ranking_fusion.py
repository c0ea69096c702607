"""Reciprocal-rank fusion: a rule that several rankings put high comes first."""

from collections.abc import Mapping

import numpy as np

from pa_console.policy.postings import Floats
from pa_console.policy.ranking import Ranking, Scores

OFFSET = 60.0
"""How little the first places differ; the value of Cormack, Clarke and Buettcher (SIGIR 2009)."""


class FusionRanking:
    """Sums 1 / (OFFSET + place) over rankings of the same rules; equal scores share a place."""

    def __init__(self, rankings: Mapping[str, Ranking]) -> None:
        """Fuse `rankings`; their names name the parts of the score."""
        self._rankings = dict(rankings)

    def scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the fused score of each rule, and what each ranking adds to it."""
        parts: Scores = {
            name: 1.0 / (OFFSET + 1.0 + _better(ranking.scores(text)[0]))
            for name, ranking in self._rankings.items()
        }
        return np.asarray(sum(parts.values()), dtype=np.float64), parts


def _better(scores: Floats) -> Floats:
    """Return for each score how many are higher."""
    higher = len(scores) - np.searchsorted(np.sort(scores), scores, side="right")
    return higher.astype(np.float64)
