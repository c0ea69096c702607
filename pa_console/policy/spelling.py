"""How alike words are spelt, so that endings and slips of the keyboard do not hide a word."""

from collections.abc import Sequence

import numpy as np

from pa_console.policy.postings import Floats, Postings
from pa_console.policy.terms import ngrams

SHORTEST, LONGEST = 2, 4


class Spelling:
    """A list of words that any word can be compared with."""

    def __init__(self, words: Sequence[str]) -> None:
        """Index `words`, which are distinct, by their character n-grams."""
        self.words = tuple(words)
        self._places = {word: place for place, word in enumerate(words)}
        self._grams = Postings([sorted(_grams(word)) for word in words])

    def likeness(self, word: str) -> Floats:
        """Return, for each listed word, 1 for the same word and less for those spelt otherwise.

        It is the Dice coefficient of the sets of n-grams of two to four letters.
        """
        grams = _grams(word)
        both = np.zeros(len(self.words))
        for gram in grams:
            both[self._grams.of(gram)[0]] += 1.0
        alike = 2.0 * both / (self._grams.lengths + len(grams))
        place = self._places.get(word)
        if place is not None:
            alike[place] = 1.0
        return alike


def _grams(word: str) -> set[str]:
    return set(ngrams(word, SHORTEST, LONGEST))
