"""Forms of words with slots, in one notation for writing words and for parsing them.

`{who}` is a slot, `[ by {who}]` is optional, and `({who} relieves|relieve)` is a choice. All other
words stand for themselves.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

_TOKEN = re.compile(r"\{(?P<slot>\w+)\}|[\[\]()|]|[^\[\](){}|]+")
NO_DEFAULTS: Mapping[str, str] = {}


@dataclass(frozen=True)
class _Slot:
    """A slot in a form, given by its name."""

    name: str


@dataclass(frozen=True)
class _Choice:
    """A choice between several ways; if it is `optional`, it may be left out."""

    ways: "tuple[_Parts, ...]"
    optional: bool


_Parts = tuple[str | _Slot | _Choice, ...]


@dataclass(frozen=True)
class WordForm:
    """One form of words, in the notation of this module."""

    text: str

    def pattern(self, slots: Mapping[str, str]) -> str:
        """Return the regular expression of the form; `slots` has the expression of each slot."""
        return _pattern(self._parts, slots)

    def fits(self, values: Mapping[str, str]) -> bool:
        """Return whether `values` has every required slot of the form."""
        return _fits(self._parts, values)

    def write(self, values: Mapping[str, str], defaults: Mapping[str, str] = NO_DEFAULTS) -> str:
        """Return the form with its slots filled by name from `values`.

        If a choice has several ways, the one with the most slots in `values` is used. A required
        slot that is missing from `values` is filled from `defaults`. Raises KeyError if it is in
        neither.
        """
        return _written(self._parts, values, defaults)

    @cached_property
    def _parts(self) -> _Parts:
        tokens = _TOKEN.finditer(self.text)
        (parts,), _ = _ways(tokens)
        return parts


def _ways(tokens: Iterator[re.Match[str]]) -> tuple[tuple[_Parts, ...], str]:
    """Return the ways up to a closing bracket, and that bracket; '' if the form ends first."""
    ways: list[_Parts] = []
    parts: list[str | _Slot | _Choice] = []
    for token in tokens:
        match token[0]:
            case "[" | "(" as opening:
                inner, _ = _ways(tokens)
                parts.append(_Choice(inner, optional=opening == "["))
            case "]" | ")" as closing:
                return (*ways, tuple(parts)), closing
            case "|":
                ways.append(tuple(parts))
                parts = []
            case words:
                parts.append(_Slot(token["slot"]) if token["slot"] else words)
    return (*ways, tuple(parts)), ""


def _pattern(parts: _Parts, slots: Mapping[str, str]) -> str:
    pieces: list[str] = []
    for part in parts:
        match part:
            case _Slot(name):
                pieces.append(slots[name])
            case _Choice(ways, optional):
                either = "|".join(_pattern(way, slots) for way in ways)
                pieces.append(f"({either}){'?' * optional}")
            case words:
                pieces.append(words)
    return "".join(pieces)


def _fits(parts: _Parts, values: Mapping[str, str]) -> bool:
    for part in parts:
        match part:
            case _Slot(name) if name not in values:
                return False
            case _Choice(ways, optional) if not optional and not any(
                _fits(way, values) for way in ways
            ):
                return False
            case _:
                pass
    return True


def _written(parts: _Parts, values: Mapping[str, str], defaults: Mapping[str, str]) -> str:
    pieces: list[str] = []
    for part in parts:
        match part:
            case _Slot(name):
                pieces.append(values[name] if name in values else defaults[name])
            case _Choice(ways, optional):
                fitting: Sequence[_Parts] = [way for way in ways if _fits(way, values)]
                if fitting or not optional:
                    way = (
                        max(fitting, key=lambda candidate: _says(candidate, values))
                        if fitting
                        else ways[0]
                    )
                    pieces.append(_written(way, values, defaults))
            case words:
                pieces.append(words)
    return "".join(pieces)


def _says(parts: _Parts, values: Mapping[str, str]) -> int:
    """Return the number of slots in `parts` for which `values` has a value."""
    number = 0
    for part in parts:
        match part:
            case _Slot(name):
                number += name in values
            case _Choice(ways):
                number += max(_says(way, values) for way in ways)
            case _:
                pass
    return number
