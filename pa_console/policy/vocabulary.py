"""Loads the vocabulary that retrieval uses, and says how well words fit its groups."""

from functools import cache
from pathlib import Path

import numpy as np

from pa_console.policy.postings import Floats
from pa_console.policy.spelling import Spelling
from pa_console.policy.terms import words_of
from pa_console.resources import data_folder
from pa_console.schema.document import Document
from pa_console.schema.vocabulary import Vocabulary

ALIKE = 0.6
"""From what similarity of spelling on a word is taken for a word of a group."""


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
