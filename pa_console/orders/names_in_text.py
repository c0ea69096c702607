"""Which names of a world a mission's words mean: verbatim, spelled out, or nearly so."""

import re
from collections.abc import Iterable

from rapidfuzz import fuzz, process

NEARLY = 85.0
"""Least similarity of two words, of 100, for one to be a misspelling of the other."""
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")


def named(names: Iterable[str], text: str) -> list[str]:
    """Return the names that `text` contains, as they are or in words: `Drone_T01`, `drone T01`."""
    said = f" {' '.join(_words(text))} "
    verbatim = {word.lower() for word in re.findall(r"\w+", text)}
    return [
        name for name in names if name.lower() in verbatim or f" {' '.join(_words(name))} " in said
    ]


def names_meant(names: Iterable[str], text: str) -> list[str]:
    """Return the names whose own words `text` contains, those it contains wholly first.

    Words that most of the names share tell none of them from the others: of NorthGate and
    EastGate, "the north and east gates" means both. A word may be misspelled; a number may not.
    """
    parts = {name: _words(name) for name in names}
    common = _common(parts.values())
    said = sorted({*_words(text), *(word.lower() for word in re.findall(r"\w+", text))})
    found = {word: _is_said(word, said) for words in parts.values() for word in words}
    whole, partly = list[str](), list[str]()
    for name, words in parts.items():
        own = [word for word in words if word not in common] or words
        if name.lower() in said or all(found[word] for word in own):
            whole.append(name)
        elif any(found[word] and not word.isdigit() for word in own):
            partly.append(name)
    return whole or partly


def _words(name: str) -> list[str]:
    """Return the words of a name or text: `NorthGate_2` is north, gate, 2."""
    return [word.lower() for word in _WORD.findall(name)]


def _common(names: Iterable[list[str]]) -> set[str]:
    listed = [set(words) for words in names]
    every = {word for words in listed for word in words}
    return {
        word
        for word in every
        if len(listed) > 1 and sum(word in words for words in listed) > len(listed) / 2
    }


def _is_said(word: str, said: list[str]) -> bool:
    if word in said:
        return True
    if len(word) < 4 or not word.isalpha():
        return False
    return process.extractOne(word, said, scorer=fuzz.ratio, score_cutoff=NEARLY) is not None
