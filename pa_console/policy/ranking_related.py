"""Finds rules by the same words, words spelt alike, and words that concern the same thing."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pa_console.policy.postings import Floats, Postings
from pa_console.policy.ranking import Scores
from pa_console.policy.spelling import Spelling
from pa_console.policy.terms import rule_words, words_of
from pa_console.policy.vocabulary import Groups
from pa_console.schema.rule import Rule
from pa_console.schema.vocabulary import Vocabulary

ALIKE = 0.3
"""From what likeness on another spelling counts; it then counts as its square."""
RELATED = 0.8
"""What a related word counts, where the same word counts 1."""
LENGTH = 0.4
"""How much longer rules are held back: 0 not at all, 1 in proportion to their length."""
LEVELS = 10
"""In how many steps it is told how near rules come to a word."""
_ROUNDING = 1e-9


class RelatedRanking:
    """The share of what a mission says that a rule speaks of, in the same or in other words.

    A rule comes as near to a word of the mission as its nearest word: 1 if that is the same, the
    square of their likeness if it is spelt otherwise, RELATED times how well both fit a group of
    the vocabulary if it concerns the same thing. Nearness counts by how telling it is: the
    logarithm of the number of rules over the number that come as near. So among many rules that
    speak of a thing, the few that use the mission's own word are found. `words` is what rules
    score by spelling, `related` what they score by the vocabulary. Longer rules are held back.
    """

    def __init__(self, rules: Sequence[Rule], vocabulary: Vocabulary) -> None:
        """Index `rules`, whose words are compared with those of `vocabulary`."""
        self._groups = Groups(vocabulary)
        words = [
            sorted({word for word in rule_words(rule) if word not in self._groups.ignored})
            for rule in rules
        ]
        self._postings = Postings(words)
        self._spelling = Spelling(list(self._postings.terms))
        self._fits = np.array([self._groups.fit(word) for word in self._spelling.words])
        lengths = self._postings.lengths
        mean = max(float(lengths.mean()), 1.0) if len(rules) else 1.0
        self._held_back = 1.0 - LENGTH + LENGTH * lengths / mean

    def scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the share of `text` that each rule speaks of, about 0 to 1."""
        size = self._postings.size
        spelt, related, whole = np.zeros(size), np.zeros(size), 0.0
        for word in dict.fromkeys(words_of(text)):
            if word in self._groups.ignored:
                continue
            same, other = self._nearest(word)
            nearest = np.maximum(same, other)
            level = (nearest * LEVELS + _ROUNDING).astype(np.int64)
            telling = _telling(np.bincount(level, minlength=LEVELS + 1))
            worth = nearest * telling[level]
            spelt += np.where(same >= other, worth, 0.0)
            related += np.where(same >= other, 0.0, worth)
            whole += float(telling[LEVELS])
        scale = self._held_back * max(whole, 1e-9)
        spelt, related = spelt / scale, related / scale
        return spelt + related, {"words": spelt, "related": related}

    def _nearest(self, word: str) -> tuple[Floats, Floats]:
        """Return how near each rule comes to `word` by spelling, and by the vocabulary."""
        alike = self._spelling.likeness(word)
        alike = np.where(alike >= ALIKE, alike**2, 0.0)
        fit = self._groups.fit(word)
        groups = np.flatnonzero(fit)
        if len(groups) and len(self._fits):
            akin = RELATED * (self._fits[:, groups] * fit[groups]).max(axis=1)
        else:
            akin = np.zeros(len(alike))
        return self._spread(alike), self._spread(akin)

    def _spread(self, values: Floats) -> Floats:
        """Return for each rule the highest of the `values` of its words, zero for none."""
        highest = np.zeros(self._postings.size)
        for number in np.flatnonzero(values):
            places = self._postings.at(int(number))[0]
            highest[places] = np.maximum(highest[places], values[number])
        return highest


def _telling(counts: NDArray[np.int64]) -> Floats:
    """Return how telling each level of nearness is, given how many rules are at it; never < 0."""
    as_near = np.cumsum(counts[::-1])[::-1]
    rules = as_near[0]
    return np.log1p((rules - as_near + 0.5) / (as_near + 0.5))
