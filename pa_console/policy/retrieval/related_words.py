"""Groups of words about the same thing, and the likeness of spellings."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from pa_console.policy.retrieval.inverted_index import Floats, Postings, ngrams, words_of
from pa_console.resources import data_folder
from pa_console.schema.base import Name, StrictModel
from pa_console.schema.document import Document

Word = Annotated[str, Field(pattern=r"^[^\W_]+$", max_length=40)]


class Vocabulary(StrictModel):
    """Groups of words that concern the same thing, and words that concern nothing.

    A word may stand in several groups, but not both in a group and among the ignored ones.
    """

    name: Name = "none"
    groups: dict[Name, tuple[Word, ...]] = {}
    ignored: tuple[Word, ...] = Field(default=(), description="words that are not looked for")

    @model_validator(mode="after")
    def _ignored_words_have_no_group(self) -> Self:
        ignored = set(self.ignored)
        for group, words in self.groups.items():
            for index, word in enumerate(words):
                if word in ignored:
                    raise ValueError(
                        f"groups.{group}.{index}: {word!r} is also ignored; take it out of one"
                    )
        return self


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


ALIKE = 0.6
"""The similarity of spelling from which a word counts as one of a group."""


def load_vocabulary(path: Path) -> Vocabulary:
    """Read the vocabulary at `path`; raises DocumentError with file, line and field."""
    return Document.read(path).parse(Vocabulary)


@cache
def default_vocabulary() -> Vocabulary:
    """Return the vocabulary that is installed; raises DocumentError when it cannot be used."""
    return load_vocabulary(data_folder() / "rules" / "vocabulary" / "english.yaml")


class Groups:
    """The groups of a vocabulary as numbers, so that words can be compared by them."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        """Index the words of the groups by their spelling."""
        self.ignored = {word for text in vocabulary.ignored for word in words_of(text)}
        members: dict[str, set[int]] = {}
        for number, words in enumerate(vocabulary.groups.values()):
            for word in words:
                members.setdefault(word.casefold(), set()).add(number)
        self._spelling = Spelling(sorted(members))
        self._members = np.zeros((len(members), len(vocabulary.groups)))
        for row, word in enumerate(self._spelling.words):
            self._members[row, sorted(members[word])] = 1.0

    def fit(self, word: str) -> Floats:
        """Return how well `word` fits each group, in [0, 1]: its likeness to the nearest member."""
        alike = self._spelling.likeness(word)
        rows = np.flatnonzero(alike >= ALIKE)
        if not len(rows):
            return np.zeros(self._members.shape[1])
        return (self._members[rows] * alike[rows, None]).max(axis=0)
