"""Finds the rules that concern a mission (paper, Steps 2 and 3); it never decides enforcement."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from pa_console.policy.retrieval.inverted_index import Floats, ngrams
from pa_console.policy.retrieval.ranking import (
    Bm25Ranking,
    FusionRanking,
    PaperRanking,
    Ranking,
    RelatedRanking,
    Scores,
    best,
    rounded,
)
from pa_console.policy.retrieval.related_words import Vocabulary, default_vocabulary
from pa_console.schema.rule import Rule, RuleHit

_MAKERS: dict[str, Callable[[Sequence[Rule], Vocabulary], Ranking]] = {
    "paper": lambda rules, _: PaperRanking(rules),
    "bm25": lambda rules, _: Bm25Ranking(rules),
    "ngrams": lambda rules, _: Bm25Ranking(rules, "ngrams", ngrams),
    "fusion": lambda rules, _: FusionRanking(
        {"bm25": Bm25Ranking(rules), "ngrams": Bm25Ranking(rules, "ngrams", ngrams)}
    ),
    "related": RelatedRanking,
}
METHODS = tuple(_MAKERS)
DEFAULT_METHOD = "related"


class Retriever:
    """Scores rules against a mission text by one of METHODS and picks the best.

    The rules are held in the order of their ids, so that equal scores are ordered by rule id
    whatever the order of the rule file.
    """

    def __init__(
        self,
        rules: Iterable[Rule],
        method: str = DEFAULT_METHOD,
        vocabulary: Vocabulary | None = None,
    ) -> None:
        """Index `rules`; raises ValueError for an unknown method.

        `vocabulary` is for the method `related`; default: the installed one.
        """
        if method not in _MAKERS:
            raise ValueError(f"unknown retrieval method {method!r}; known: {', '.join(METHODS)}")
        self.method = method
        ordered = sorted(rules, key=lambda rule: rule.id)
        self._ids = [rule.id for rule in ordered]
        self._pinned = np.array([rule.priority == "critical" for rule in ordered], dtype=bool)
        self._vocabulary = default_vocabulary() if vocabulary is None else vocabulary
        self._ranking = _MAKERS[method](ordered, self._vocabulary)

    def over(self, rules: Iterable[Rule]) -> "Retriever":
        """Return the same retriever over other rules."""
        return Retriever(rules, self.method, self._vocabulary)

    def retrieve(self, text: str, k: int = 3) -> tuple[RuleHit, ...]:
        """Return the pinned rules, then the `k` others that score best; no rule twice.

        Every Critical rule is pinned: whatever the mission says, the models see it. Raises
        ValueError for a negative `k`.
        """
        if k < 0:
            raise ValueError(f"cannot retrieve {k} rules")
        scores, parts = self._scores(text)
        chosen: list[int] = []
        for places, number in (
            (np.flatnonzero(self._pinned), len(self._ids)),
            (np.flatnonzero(~self._pinned), k),
        ):
            chosen += [int(places[place]) for place in best(scores[places], number)]
        return tuple(self._hit(place, scores, parts) for place in chosen)

    def rank(self, text: str, k: int) -> tuple[str, ...]:
        """Return the ids of the `k` rules that score best, pinned or not, best first."""
        return tuple(self._ids[place] for place in best(self._scores(text)[0], k))

    def score_all(self, text: str) -> tuple[RuleHit, ...]:
        """Return every rule with its score and its parts, best first."""
        scores, parts = self._scores(text)
        places = best(scores, len(self._ids))
        return tuple(self._hit(place, scores, parts) for place in places)

    def _scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the scores and their parts, rounded before any is compared."""
        scores, parts = self._ranking.scores(text)
        return rounded(scores), {name: rounded(values) for name, values in parts.items()}

    def _hit(self, place: int, scores: Floats, parts: Scores) -> RuleHit:
        return RuleHit(
            rule_id=self._ids[place],
            score=float(scores[place]),
            components={name: float(values[place]) for name, values in parts.items()},
            pinned=bool(self._pinned[place]),
        )
