"""Entity linking: names said in other words become the world's own, `uav four` Drone_T04.

A small model reads a name far better as it is written than as operators say it. Only what can mean
one thing is changed; the rest is left to the model. Everything is taken from the world.
"""

import re
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

from pa_console.language.world_names import DIGITS, GATE, NUMBERS, WORD, WorldNames
from pa_console.schema.world import World

_BEFORE_NUMBER = frozenset(("number", "no", "nr", "t", "tango"))
_AND = frozenset((",", "and", "&", "/", "+", "or", "plus"))
_MEASURES = frozenset(("m", "km", "meters", "metres", "minutes", "min", "seconds", "percent"))
_DETERMINERS = frozenset(
    (
        *("a", "an", "one", "two", "three", "four", "any", "all", "both", "every", "each", "some"),
        *(
            "another",
            "the",
            "this",
            "that",
            "your",
            "our",
            "my",
            "of",
            "available",
            "free",
            "spare",
        ),
        *("idle", "single", "other", "more"),
    )
)
_TOKEN = re.compile(rf"{WORD.pattern}|[,&/+]")
_ARTICLES = re.compile(r"\b(?:the )+$")
_JOINTS = frozenset(("", " ", "-", "_", " #", "#"))
"""The marks between the words of one name; a dot only after an abbreviation."""
_LONGEST = 4
"""Words of a place's name that are looked at together."""
_MOST_DIGITS = 4


class _Token(NamedTuple):
    word: str
    start: int
    end: int


class _Link(NamedTuple):
    """Tokens from `first` up to `end` that mean `name`."""

    first: int
    end: int
    name: str


def link_names(world: World, text: str) -> str:
    """Return `text` with the assets and places of `world` under their names."""
    return LinkedText.of(world, text).text


class LinkedText(NamedTuple):
    """A text with names in place of their descriptions, and their places in the `original`.

    `names` are ranges of characters of the original, each with the name.
    """

    original: str
    names: tuple[tuple[int, int, str], ...]

    @classmethod
    def of(cls, world: World, text: str) -> "LinkedText":
        """Link the names of `world` in `text`."""
        linker = _Linker(WorldNames.of(world), text)
        return cls(text, tuple((*linker.span(link), link.name) for link in linker.links()))

    @property
    def text(self) -> str:
        """The text with the names."""
        parts, done = list[str](), 0
        for start, end, name in self.names:
            parts += [self.original[done:start], name]
            done = end
        return "".join((*parts, self.original[done:]))

    def said(self, start: int, end: int) -> str:
        """Return the original words for the characters from `start` to `end` of the text."""
        return self.original[self._before(start, last=False) : self._before(end, last=True)]

    def _before(self, at: int, *, last: bool) -> int:
        """Return where in the original the character `at` of the text stands.

        Within a name it is where that begins, or with `last` where it ends.
        """
        shift = 0
        for start, end, name in self.names:
            here = start + shift
            if at <= here:
                break
            if at < here + len(name):
                return end if last else start
            shift += len(name) - (end - start)
        return at - shift


class _Linker:
    """The words of one text beside the names of one world."""

    def __init__(self, names: WorldNames, text: str) -> None:
        self._names, self._text = names, text
        self._tokens = [
            _Token(found.group().lower(), found.start(), found.end())
            for found in _TOKEN.finditer(text)
        ]
        self._linked = 0
        """The end of the latest link."""

    def links(self) -> Iterator[_Link]:
        """Yield the replacements, from left to right."""
        at = 0
        while at < len(self._tokens):
            found = [*self._gates(at)] or [*self._place(at)] or [*self._assets(at)]
            found = found or [*self._kind(at)]
            if found and all(map(self._whole, found)):
                yield from found
                self._linked = found[-1].end
            at = max(at + 1, self._linked)

    def _whole(self, link: _Link) -> bool:
        """Return True if `link` has whole words: `gate North` is no name in `gate NorthGate`.

        Nor is the `s gate` of `its owner's gate` the south gate.
        """
        start, end = self.span(link)
        if self._word(link.first) == "s" and self._text[max(start - 1, 0) : start] in ("'", "’"):
            return False
        around = self._text[max(start - 1, 0) : start] + self._text[end : end + 1]
        return not re.search(r"\w", around)

    def span(self, link: _Link) -> tuple[int, int]:
        """Return where the characters of `link` begin, with an article before it, and end."""
        start, end = self._tokens[link.first].start, self._tokens[link.end - 1].end
        before = self._text[:start].lower()
        if before.endswith("frame_"):
            start -= len("frame_")
        elif self._names.is_place(link.name) and (article := _ARTICLES.search(before)):
            start = article.start()
        return start, end

    def _gates(self, at: int) -> Iterator[_Link]:
        """Yield the gates of a list such as `north, east and the west gate` from `at`."""
        gates: list[_Link] = []
        while name := self._names.gate_with(self._word(at)):
            gates.append(_Link(at, at + 1, name))
            at = self._after_and(at + 1)
        if len(gates) > 1 and self._word(at) in (GATE, f"{GATE}s"):
            yield from (*gates[:-1], gates[-1]._replace(end=at + 1))

    def _place(self, at: int) -> Iterator[_Link]:
        """Yield the place named by the tokens from `at`, the longest name first."""
        for end in range(min(at + _LONGEST, len(self._tokens)), at, -1):
            words = [token.word for token in self._tokens[at:end]]
            name = self._names.place(words) if self._together(at, end) else None
            if name is not None:
                yield _Link(at, end, name)
                return

    def _assets(self, at: int) -> Iterator[_Link]:
        """Yield the asset that is named from `at`, and those of the same team behind it."""
        word = self._word(at)
        team = self._names.team(word)
        if not team and word != "t" and len(word) == 1 and self._is_numbered(at):
            team = self._names.initial(word)
        if (not team and word != "t") or self._counted(at):
            return
        end, number = self._number(at + 1)
        if number is None:
            return
        name = self._names.asset(team, number) or self._names.absent(team, number)
        while name is not None:
            yield _Link(at, end, name)
            at = self._after_and(end)
            listed = at > end and (word.endswith("s") or self._word(at) == "t")
            end, number = self._number(at) if listed else (at, None)
            name = None if number is None else self._names.asset(team, number)

    def _is_numbered(self, at: int) -> bool:
        """Return whether digits follow token `at` without a blank, as in `D4`."""
        end = self._tokens[at].end
        return self._text[end : end + 1].isdigit()

    def _kind(self, at: int) -> Iterator[_Link]:
        """Yield the kind for a team's own word that stands for any of its assets."""
        before, plain = self._word(at - 1), self._names.kind_word(self._word(at))
        if plain is not None and before == "an":
            yield _Link(at - 1, at + 1, f"a {plain}")
        elif plain is not None and (before in _DETERMINERS or before.isdigit()):
            yield _Link(at, at + 1, plain)

    def _number(self, at: int) -> tuple[int, int | None]:
        """Return the end and the value of the number at token `at`, if there is one."""
        while self._word(at) in _BEFORE_NUMBER and self._together(at - 1, at + 1):
            at += 1
        word, said = self._word(at), ""
        if self._word(at - 1) not in _AND and not self._together(max(at - 1, 0), at + 1):
            return at, None
        if word.isdigit():
            at, said = at + 1, word
        elif word in NUMBERS[len(DIGITS) :]:
            at, said = at + 1, str(NUMBERS.index(word))
        while self._word(at) in DIGITS and said in ("", "0") and not word.isdigit():
            at, said = at + 1, said + str(DIGITS.index(self._word(at)))
        fits = 0 < len(said) <= _MOST_DIGITS and self._word(at) not in _MEASURES
        return at, int(said) if fits else None

    def _counted(self, at: int) -> bool:
        """Return whether a number stands before token `at`, as in `two drones`."""
        before = self._word(at - 1)
        return at != self._linked and (before in NUMBERS or before.isdigit())

    def _after_and(self, at: int) -> int:
        """Return the first token from `at` that is no comma, `and` or `and the`."""
        first = at
        while self._word(at) in _AND or (at > first and self._word(at) == "the"):
            at += 1
        return at

    def _word(self, at: int) -> str:
        return self._tokens[at].word if 0 <= at < len(self._tokens) else ""

    def _together(self, first: int, end: int) -> bool:
        """Return whether only blanks or marks of a name stand between the tokens."""
        pairs = pairwise(self._tokens[first:end])
        return end <= len(self._tokens) and all(self._joined(*pair) for pair in pairs)

    def _joined(self, one: _Token, other: _Token) -> bool:
        gap = self._text[one.end : other.start]
        return (gap.removeprefix(".") if one.word in _BEFORE_NUMBER else gap) in _JOINTS
