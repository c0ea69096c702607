"""Status words with their colours, words for kinds of assets, short names of assets and tracks."""

import re
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from textual.content import Content

from pa_console.schema.world import AssetKind
from pa_console.views.status_words import STATUSES, Tone, status_of

GOOD, BAD, WARN = "$text-success", "$text-error", "$text-warning"
CALM, QUIET, NOTE = "$text-primary", "$quiet", "$text-accent"
STYLES: dict[Tone, str] = {
    "": "",
    "good": GOOD,
    "bad": BAD,
    "warn": WARN,
    "calm": CALM,
    "quiet": QUIET,
    "note": NOTE,
}


class Term(NamedTuple):
    """The presentation of one status everywhere."""

    glyph: str
    word: str
    style: str

    @property
    def content(self) -> Content:
        """The glyph and the word, coloured."""
        return Content.styled(f"{self.glyph} {self.word}", self.style)


def term(family: str, value: str) -> Term:
    """Return how `value` of `family` is shown; a value not in the table is shown as unknown."""
    glyph, word, tone = status_of(family, value)
    return Term(glyph, word, STYLES[tone])


TERMS = {name: term(*name.split(".", 1)) for name in STATUSES}
"""Every status word, for a page that explains them."""


KIND_WORDS: dict[AssetKind, str] = {"uav": "UAV", "ugv": "UGV", "robot": "ground robot"}


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Return a name of a letter and a number for each asset, e.g. `Drone_T01` -> `D1`.

    Names that would be the same get consecutive numbers instead.
    """
    names = tuple(names)
    first = {name: name[:1].upper() + _number(name) for name in names}
    counts = Counter(first.values())
    if all(_number(name) for name in names) and max(counts.values(), default=0) <= 1:
        return first
    seen: Counter[str] = Counter()
    result: dict[str, str] = {}
    for name in names:
        letter = name[:1].upper()
        seen[letter] += 1
        result[name] = f"{letter}{seen[letter]}"
    return result


def _number(name: str) -> str:
    match = re.search(r"(\d+)$", name)
    return str(int(match[1])) if match else ""


def track_names(names: Iterable[str]) -> dict[str, str]:
    """Return the number at the end of each track's name, or its place where that is not unique."""
    names = tuple(names)
    numbers = [_number(name) for name in names]
    if all(numbers) and len(set(numbers)) == len(numbers):
        return dict(zip(names, numbers, strict=True))
    return {name: str(place) for place, name in enumerate(names, start=1)}
