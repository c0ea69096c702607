"""The words of an order one after another, and a place among them from which a parser reads on.

Clitics are words of their own: `isn't` is read as *is*, *not*, and `Drone_T01's` as the name, *'s*.
"""

import re
from collections.abc import Collection, Sequence
from typing import NamedTuple

_TOKEN = re.compile(r"[^\W_](?:[\w-]*\w)?|['’](?:s|re|ve|d|ll|m)\b|n['’]t\b|[^\w\s]")
_NOT = re.compile(r"(?<=[a-z])n['’]t\b", re.IGNORECASE)
_SAME = {"n't": "not", "’s": "'s", "’re": "'re", "can't": "can", "noone": "nobody"}


class Token(NamedTuple):
    """A word in lower case, as it was written, and where its characters begin and end."""

    word: str
    said: str
    start: int
    end: int


def read_tokens(text: str) -> tuple[Token, ...]:
    """Return the words and stops of `text`."""
    found: list[Token] = []
    for match in _TOKEN.finditer(text):
        said, start = match[0], match.start()
        cut = re.search(r"n['’]t$", text[start : match.end() + 2], re.IGNORECASE)
        if said.lower().endswith("n") and len(said) > 1 and cut is not None:
            said = said[:-1]
        found.append(Token(_word(said), said, start, start + len(said)))
        if len(said) < len(match[0]):
            found.append(Token("not", "n't", start + len(said), match.end() + 2))
    return tuple(_without_halves(found))


def _word(said: str) -> str:
    low = said.lower()
    return _SAME.get(low, low)


def _without_halves(tokens: Sequence[Token]) -> list[Token]:
    """Return the tokens without the halves of contractions such as *isn't*."""
    kept: list[Token] = []
    for token in tokens:
        if not kept or token.start >= kept[-1].end:
            kept.append(token)
    return kept


class Reader:
    """Reads tokens from the one at `at` on; what is not there is not read."""

    def __init__(self, tokens: Sequence[Token], at: int = 0) -> None:
        self.tokens, self.at = tokens, at

    def word(self, ahead: int = 0) -> str:
        """Return the word `ahead` of here; '' beyond the end and before the beginning."""
        index = self.at + ahead
        return self.tokens[index].word if 0 <= index < len(self.tokens) else ""

    def said(self) -> str:
        """Return the word here as it was written; '' at the end."""
        return self.tokens[self.at].said if self.at < len(self.tokens) else ""

    @property
    def over(self) -> bool:
        """True if no token is left."""
        return self.at >= len(self.tokens)

    def take(self, *ways: str) -> str:
        """Read the first of `ways`, phrases of one or more words, that is here; '' for none."""
        for way in ways:
            words = way.split()
            if all(self.word(n) == word for n, word in enumerate(words)):
                self.at += len(words)
                return way
        return ""

    def take_in(self, words: Collection[str]) -> str:
        """Read one word that is among `words`; '' where the word here is not."""
        word = self.word()
        if word and word in words:
            self.at += 1
            return word
        return ""

    def skip(self, words: Collection[str]) -> None:
        """Read as many of `words` as are here."""
        while self.take_in(words):
            pass
