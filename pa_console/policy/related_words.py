"""Parts of the search for rules by words: an inverted index, spellings, groups of related words."""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pa_console.resources import data_folder
from pa_console.schema.base import Name, StrictModel
from pa_console.schema.document import Document
from pa_console.schema.rule import Rule

SHORTEST_NGRAM, LONGEST_NGRAM = 3, 5
_WORD = re.compile(r"[^\W_]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_END = "\N{LINE SEPARATOR}"

SHORTEST, LONGEST = 2, 4
ALIKE = 0.6
"""The least similarity of spelling at which a word counts as a member of a group."""

_CHUNK = 10_000


def words_of(text: str) -> list[str]:
    """Return the words of `text` in order, case-folded, in any script.

    Names are split into their parts: EastGate gives east and gate, Drone_T01 gives drone and t01.
    """
    return _WORD.findall(_CAMEL.sub(" ", text).casefold())


def rule_words(rule: Rule) -> list[str]:
    """Return the words by which `rule` is found: those of its text and of its tags."""
    return words_of(" ".join((rule.text, *rule.tags)))


def ngrams(word: str, shortest: int = SHORTEST_NGRAM, longest: int = LONGEST_NGRAM) -> list[str]:
    """Return the character n-grams of `word` with its two ends marked, shortest first."""
    marked = f"{_END}{word}{_END}"
    return [
        marked[start : start + size]
        for size in range(shortest, longest + 1)
        for start in range(len(marked) - size + 1)
    ]


Floats = NDArray[np.float64]
Numbers = NDArray[np.int32]


class Postings:
    """An inverted index: the documents that contain each term, ascending, and how often.

    `words` are the words of each document. `terms` returns the terms of a word: the word itself, or
    its character n-grams. Each distinct word is split only once.
    """

    def __init__(
        self, words: Sequence[Sequence[str]], terms: Callable[[str], Iterable[str]] | None = None
    ) -> None:
        """Index the documents `words`."""
        self.size = len(words)
        self.terms: dict[str, int] = {}
        parts: dict[str, Numbers] = {}
        documents: list[Numbers] = []
        numbers: list[Numbers] = []
        counts: list[Numbers] = []
        self.lengths = np.zeros(self.size)
        for start in range(0, self.size, _CHUNK):
            chunk = [[self._parts(word, terms, parts) for word in document]
                     for document in words[start : start + _CHUNK]]  # fmt: skip
            sizes = [sum(len(part) for part in document) for document in chunk]
            self.lengths[start : start + len(chunk)] = sizes
            flat = [part for document in chunk for part in document]
            if not flat:
                continue
            term_numbers = np.concatenate(flat).astype(np.int64)
            owners = np.repeat(np.arange(start, start + len(chunk)), sizes)
            pairs, often = np.unique(term_numbers * self.size + owners, return_counts=True)
            numbers.append((pairs // self.size).astype(np.int32))
            documents.append((pairs % self.size).astype(np.int32))
            counts.append(often.astype(np.int32))
        nothing = [np.zeros(0, dtype=np.int32)]
        number = np.concatenate(numbers or nothing)
        order = np.argsort(number, kind="stable")
        self._documents = np.concatenate(documents or nothing)[order]
        self._counts = np.concatenate(counts or nothing)[order]
        self._starts = np.searchsorted(number[order], np.arange(len(self.terms) + 1))

    def _parts(
        self, word: str, terms: Callable[[str], Iterable[str]] | None, parts: dict[str, Numbers]
    ) -> Numbers:
        """Return the numbers of the terms of `word`; new terms get the next numbers."""
        if word not in parts:
            written = (word,) if terms is None else terms(word)
            new = [self.terms.setdefault(term, len(self.terms)) for term in written]
            parts[word] = np.array(new, dtype=np.int32)
        return parts[word]

    def of(self, term: str) -> tuple[Numbers, Numbers]:
        """Return the documents that contain `term`, and how often each contains it."""
        number = self.terms.get(term)
        if number is None:
            return self._documents[:0], self._counts[:0]
        return self.at(number)

    def at(self, number: int) -> tuple[Numbers, Numbers]:
        """Return the documents that contain the term `number`, and how often each contains it."""
        span = slice(self._starts[number], self._starts[number + 1])
        return self._documents[span], self._counts[span]


Word = Annotated[str, Field(pattern=r"^[^\W_]+$", max_length=40)]


class Vocabulary(StrictModel):
    """Groups of words that concern the same thing, and words that are ignored.

    A word may be in several groups, but not both in a group and among the ignored words.
    """

    name: Name = "none"
    groups: dict[Name, tuple[Word, ...]] = {}
    ignored: tuple[Word, ...] = Field(default=(), description="words that the search ignores")

    @model_validator(mode="after")
    def _ignored_words_have_no_group(self) -> Self:
        ignored = set(self.ignored)
        for group, words in self.groups.items():
            for index, word in enumerate(words):
                if word in ignored:
                    raise ValueError(
                        f"groups.{group}.{index}: {word!r} is also ignored; remove it from one"
                    )
        return self


class Spelling:
    """A list of words with which any word can be compared."""

    def __init__(self, words: Sequence[str]) -> None:
        """Index `words`, which are distinct, by their character n-grams."""
        self.words = tuple(words)
        self._places = {word: place for place, word in enumerate(words)}
        self._grams = Postings([sorted(_grams(word)) for word in words])

    def likeness(self, word: str) -> Floats:
        """Return, for each listed word, 1 if it is the same and less if it is spelled differently.

        The likeness is the Dice coefficient of the sets of n-grams of two to four letters.
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


def load_vocabulary(path: Path) -> Vocabulary:
    """Read the vocabulary at `path`; raises DocumentError with file, line and field."""
    return Document.read(path).parse(Vocabulary)


@cache
def default_vocabulary() -> Vocabulary:
    """Return the installed vocabulary; raises DocumentError if it cannot be used."""
    return load_vocabulary(data_folder() / "rules" / "vocabulary" / "english.yaml")


class Groups:
    """The groups of a vocabulary as numbers, by which words can be compared."""

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
        # Rule sets and missions repeat their words, so that a cache pays off.
        self.fit: Callable[[str], Floats] = lru_cache(maxsize=4096)(self._fit)
        """A function that returns how well a word fits each group, in [0, 1], as a shared,
        read-only array."""

    @classmethod
    def of(cls, vocabulary: Vocabulary) -> "Groups":
        """Return the groups of `vocabulary`; the groups of the installed one are built once."""
        return _default_groups() if vocabulary is default_vocabulary() else cls(vocabulary)

    def _fit(self, word: str) -> Floats:
        """Return the likeness of `word` to the nearest member of each group."""
        alike = self._spelling.likeness(word)
        rows = np.flatnonzero(alike >= ALIKE)
        if not len(rows):
            return np.zeros(self._members.shape[1])
        return (self._members[rows] * alike[rows, None]).max(axis=0)


@cache
def _default_groups() -> Groups:
    return Groups(default_vocabulary())
