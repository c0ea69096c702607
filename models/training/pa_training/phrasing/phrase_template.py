"""Phrase templates: text with {slots}, (choices|of|several) and [parts that may be left out].

A backslash takes the meaning from the mark after it.
"""

import random
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

Fill = Callable[[str, str], str]
"""Gives the words of a slot: (name of the slot, the text written so far)."""

_MARKS = re.compile(r"\\(.)|\{([a-z_]*)\}|([()\[\]|{}])", re.DOTALL)


@dataclass(frozen=True)
class Sequence:
    """Parts that follow each other: text, a slot, a choice or an optional part."""

    parts: tuple["str | Slot | Choice | Maybe", ...]


@dataclass(frozen=True)
class Slot:
    """A place that the program fills."""

    name: str


@dataclass(frozen=True)
class Choice:
    """One of several wordings."""

    options: tuple[Sequence, ...]


@dataclass(frozen=True)
class Maybe:
    """A wording that is there or not."""

    inner: Sequence


class Template:
    """One template, parsed once."""

    def __init__(self, source: str) -> None:
        """Parse `source`; raises ValueError saying which mark is wrong."""
        self.source = source
        tokens = list(_tokens(source))
        self._tree, rest = _sequence(tokens, 0, "")
        if rest != len(tokens):
            raise ValueError(f"unbalanced {tokens[rest][1]!r}")
        self.slots = frozenset(_slots(self._tree))
        self.always = frozenset(_always(self._tree))

    @property
    def words(self) -> frozenset[str]:
        """The words of the template itself, in lower case."""
        text = " ".join(text for kind, text in _tokens(self.source) if kind == "text")
        return frozenset(re.findall(r"[a-z]+", text.lower()))

    def expand(
        self,
        rng: random.Random,
        fill: Fill,
        known: frozenset[str],
        wanted: frozenset[str] = frozenset(),
    ) -> str:
        """Return the words; parts that need a slot not in `known` are left out.

        Parts with a slot `wanted` are there.

        Raises ValueError when a slot that every wording needs is not known.
        """
        missing = self.always - known
        if missing:
            raise ValueError(f"{self.source!r} needs {', '.join(sorted(missing))}")
        words = " ".join(_expand(self._tree, _Filling(rng, fill, known, wanted), "").split())
        return re.sub(r" (?=[,.;:?!])", "", words)


@dataclass(frozen=True)
class _Filling:
    """What decides between the wordings of one template."""

    rng: random.Random
    fill: Fill
    known: frozenset[str]
    wanted: frozenset[str]

    def takes(self, part: Sequence) -> bool:
        """Tell whether an optional part is there this time."""
        if not set(_always(part)) <= self.known:
            return False
        return self.rng.random() < 0.5 or not self.wanted.isdisjoint(_slots(part))

    def option(self, options: tuple[Sequence, ...]) -> Sequence:
        """Return the option that is used this time."""
        usable = [option for option in options if set(_always(option)) <= self.known]
        wished = [option for option in usable if not self.wanted.isdisjoint(_slots(option))]
        return self.rng.choice(wished or usable)


def _tokens(source: str) -> Iterator[tuple[str, str]]:
    """Yield (kind, text): kind is `text`, `slot` or `mark`."""
    at = 0
    for match in _MARKS.finditer(source):
        if match.start() > at:
            yield "text", source[at : match.start()]
        escaped, slot, mark = match.groups()
        if escaped is not None:
            yield "text", escaped
        elif slot is not None:
            yield "slot", slot
        elif mark in "{}":
            raise ValueError(f"a single {mark!r}")
        else:
            yield "mark", mark
        at = match.end()
    if at < len(source):
        yield "text", source[at:]


def _sequence(tokens: list[tuple[str, str]], at: int, within: str) -> tuple[Sequence, int]:
    """Parse from token `at` to the end or to a mark that belongs to `within`, an opening mark."""
    parts: list[str | Slot | Choice | Maybe] = []
    while at < len(tokens):
        kind, text = tokens[at]
        if kind == "text":
            parts.append(text)
        elif kind == "slot":
            parts.append(Slot(text))
        elif text == "[":
            inner, at = _sequence(tokens, at + 1, "[")
            _close(tokens, at, "[", "]")
            parts.append(Maybe(inner))
        elif text == "(":
            options: list[Sequence] = []
            while True:
                option, at = _sequence(tokens, at + 1, "(")
                options.append(option)
                if at < len(tokens) and tokens[at] == ("mark", "|"):
                    continue
                break
            _close(tokens, at, "(", ")")
            parts.append(Choice(tuple(options)))
        elif text == "|" and within != "(":
            raise ValueError("'|' outside of parentheses")
        else:
            break
        at += 1
    return Sequence(tuple(parts)), at


def _close(tokens: list[tuple[str, str]], at: int, opening: str, closing: str) -> None:
    if at >= len(tokens) or tokens[at] != ("mark", closing):
        raise ValueError(f"{opening!r} without {closing!r}")


def _slots(tree: Sequence) -> Iterator[str]:
    """Yield every slot of `tree`."""
    for part in tree.parts:
        match part:
            case Slot(name):
                yield name
            case Choice(options):
                for option in options:
                    yield from _slots(option)
            case Maybe(inner):
                yield from _slots(inner)
            case _:
                pass


def _always(tree: Sequence) -> Iterator[str]:
    """Yield the slots that every wording of `tree` has."""
    for part in tree.parts:
        match part:
            case Slot(name):
                yield name
            case Choice(options):
                yield from set.intersection(*(set(_always(option)) for option in options))
            case _:
                pass


def _expand(tree: Sequence, filling: _Filling, before: str) -> str:
    """Return the words of `tree`; `before` is what stands in front of it."""
    text = ""
    for part in tree.parts:
        match part:
            case str():
                text += part
            case Slot(name):
                text += filling.fill(name, before + text)
            case Maybe(inner):
                if filling.takes(inner):
                    text += _expand(inner, filling, before + text)
            case Choice(options):
                text += _expand(filling.option(options), filling, before + text)
    return text
