"""Okapi BM25 over the words of the rules, or over the character n-grams of their words."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from pa_console.policy.postings import Floats, Postings
from pa_console.policy.ranking import Scores
from pa_console.policy.terms import rule_words, words_of
from pa_console.schema.rule import Rule

K1, B = 1.2, 0.75


class Bm25Ranking:
    """Sums over the terms of the mission how telling a term is and how much a rule is about it.

    The inverse document frequency is Lucene's, which is never negative. With `terms` the terms
    are what that makes of a word. A term counts once, however often the mission repeats it.
    """

    def __init__(
        self,
        rules: Sequence[Rule],
        part: str = "words",
        terms: Callable[[str], Iterable[str]] | None = None,
    ) -> None:
        """Index `rules`; `part` names the score's only part."""
        self._part, self._terms = part, terms
        self._postings = Postings([rule_words(rule) for rule in rules], terms)
        mean = float(self._postings.lengths.mean()) if rules else 1.0
        self._damping = K1 * (1.0 - B + B * self._postings.lengths / max(mean, 1.0))

    def scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the BM25 score of each rule."""
        size = self._postings.size
        scores = np.zeros(size)
        for term in self._distinct(text):
            places, counts = self._postings.of(term)
            weight = np.log1p((size - len(places) + 0.5) / (len(places) + 0.5))
            scores[places] += weight * counts * (K1 + 1.0) / (counts + self._damping[places])
        return scores, {self._part: scores}

    def _distinct(self, text: str) -> dict[str, None]:
        words = dict.fromkeys(words_of(text))
        if self._terms is None:
            return words
        return dict.fromkeys(term for word in words for term in self._terms(word))
