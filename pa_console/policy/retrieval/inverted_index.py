"""An inverted index on numpy arrays, and the terms that it counts: words and character n-grams."""

import re
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from pa_console.schema.rule import Rule

SHORTEST, LONGEST = 3, 5
_WORD = re.compile(r"[^\W_]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_END = "\N{LINE SEPARATOR}"


def words_of(text: str) -> list[str]:
    """Return the words of `text` in order, without regard to case, in any script.

    Names are taken apart as they are put together: EastGate is east and gate, Drone_T01 a drone.
    """
    return _WORD.findall(_CAMEL.sub(" ", text).casefold())


def rule_words(rule: Rule) -> list[str]:
    """Return the words under which `rule` is found: those of its text and of its tags."""
    return words_of(" ".join((rule.text, *rule.tags)))


def ngrams(word: str, shortest: int = SHORTEST, longest: int = LONGEST) -> list[str]:
    """Return the character n-grams of `word` with its two ends marked, shortest first."""
    marked = f"{_END}{word}{_END}"
    return [
        marked[start : start + size]
        for size in range(shortest, longest + 1)
        for start in range(len(marked) - size + 1)
    ]


Floats = NDArray[np.float64]
Numbers = NDArray[np.int32]

_CHUNK = 10_000


class Postings:
    """The documents (ascending) of each term of a collection, and its counts there.

    `words` are the documents' words, and `terms` returns the terms of a word: itself, or its
    character n-grams. Each word is taken apart once, however many documents hold it.
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
            found = np.concatenate(flat).astype(np.int64)
            owners = np.repeat(np.arange(start, start + len(chunk)), sizes)
            pairs, often = np.unique(found * self.size + owners, return_counts=True)
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
        self,
        word: str,
        terms: Callable[[str], Iterable[str]] | None,
        parts: dict[str, Numbers],
    ) -> Numbers:
        """Return the numbers of the terms of `word`, giving new ones their number."""
        if word not in parts:
            found = (word,) if terms is None else terms(word)
            new = [self.terms.setdefault(term, len(self.terms)) for term in found]
            parts[word] = np.array(new, dtype=np.int32)
        return parts[word]

    def of(self, term: str) -> tuple[Numbers, Numbers]:
        """Return the documents that hold `term` and how often each does."""
        number = self.terms.get(term)
        if number is None:
            return self._documents[:0], self._counts[:0]
        return self.at(number)

    def at(self, number: int) -> tuple[Numbers, Numbers]:
        """Return the documents that hold the term of `number` and how often each does."""
        span = slice(self._starts[number], self._starts[number + 1])
        return self._documents[span], self._counts[span]
