"""Takes texts apart into the terms that retrieval counts: words and character n-grams."""

import re

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
