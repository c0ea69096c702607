"""The paper's hybrid of two similarities (Steps 2 and 3)."""

import re
from collections.abc import Sequence

import numpy as np
from rapidfuzz import fuzz, process

from pa_console.policy.postings import Floats, Postings
from pa_console.policy.ranking import Scores
from pa_console.schema.rule import Rule

_WORD = re.compile(r"\w+")


class PaperRanking:
    """The mean of the sequence similarity and the Jaccard similarity of two texts, in [0, 1].

    `fuzzy` is rapidfuzz's `ratio` of the lower-cased texts: twice the longest common subsequence
    over the summed lengths. `jaccard` is the number of words in both texts over the number in
    either. The paper says that the two are combined but not how.
    """

    def __init__(self, rules: Sequence[Rule]) -> None:
        """Prepare the texts of `rules`."""
        self._texts = [rule.text.lower() for rule in rules]
        words = [sorted(_words(rule.text)) for rule in rules]
        self._postings = Postings(words)

    def scores(self, text: str) -> tuple[Floats, Scores]:
        """Return the mean of both similarities for each rule, and both."""
        if not self._texts:
            return np.zeros(0), {}
        found = process.cdist([text.lower()], self._texts, scorer=fuzz.ratio, dtype=np.float64)
        fuzzy = np.asarray(found[0], dtype=np.float64) / 100.0
        words = _words(text)
        both = np.zeros(self._postings.size)
        for word in words:
            both[self._postings.of(word)[0]] += 1.0
        either = np.maximum(self._postings.lengths + len(words) - both, 1.0)
        jaccard = both / either
        return (fuzzy + jaccard) / 2.0, {"fuzzy": fuzzy, "jaccard": jaccard}


def _words(text: str) -> set[str]:
    return set(_WORD.findall(text.lower()))
