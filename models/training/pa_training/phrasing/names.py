"""What operators call assets and places: every form that means one thing only in its world."""

import random
import re
from collections.abc import Collection, Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

from pa_console.language.name_linking import DIGITS, KIND_WORDS, NUMBERS, WORD
from pa_console.schema.world import AssetKind, World

_SPELT = """
Alpha Bravo Charlie Delta Echo Foxtrot Golf Hotel India Juliett Kilo Lima Mike November Oscar Papa
Quebec Romeo Sierra Tango Uniform Victor Whiskey Xray Yankee Zulu
"""
_DIGITS = tuple(word.title() for word in DIGITS)
_NATO = {word[0].lower(): word for word in _SPELT.split()}
_RARE = 1e-3
"""The weight that every form has at least."""
_GATE_WORDS = frozenset(("gate", "entrance", "entry", "exit", "portal", "door"))
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class Form(NamedTuple):
    """One way to say a name, and how often it is used in plain, terse, chatty and radio orders."""

    text: str
    weights: tuple[float, float, float, float]


class NameForms:
    """The forms of every asset, frame and zone of one world."""

    def __init__(self, world: World, common: Collection[str]) -> None:
        """Prepare `world`; `common` are words that do not mean a gate when they stand alone."""
        self._world = world
        self._common = common
        self._forms: dict[str, tuple[Form, ...]] = {}
        for name, spec in world.assets.items():
            self._forms[name] = asset_forms(name, spec.kind)
        for name, frame in world.frames.items():
            self._forms[name] = place_forms(name, frame.kind)
        for name in world.zones:
            self._forms.setdefault(name, place_forms(name, "zone"))
        self._owners: dict[str, set[str]] = {}
        for name, forms in self._forms.items():
            for form in forms:
                self._owners.setdefault(key_of(form.text), set()).add(name)
        for name in self._forms:
            exact = {other for other in self._owners[key_of(name)] if key_of(other) == key_of(name)}
            self._owners[key_of(name)] = exact

    def owners(self, text: str) -> frozenset[str]:
        """Return the names that `text` may mean."""
        return frozenset(self._owners.get(key_of(text), ()))

    def forms(self, name: str) -> list[Form]:
        """Return the forms of `name` that mean nothing else; the name itself is always one.

        A name that the world does not have gets forms too, so that one can speak of what is not
        there; words that are no identifier stand as they are.
        """
        forms = self._forms.get(name)
        if forms is None:
            forms = self._guessed(name)
        if _is_gate(parts_of(name)):
            forms = tuple(form for form in forms if key_of(form.text) not in self._common)
        own = [form for form in forms if self._owners.get(key_of(form.text), {name}) == {name}]
        return own or [Form(name, (1.0, 1.0, 1.0, 1.0))]

    def say(self, name: str, style: int, rng: random.Random) -> str:
        """Return one form of `name`; `style` is the column of the weights."""
        forms = self.forms(name)
        return rng.choices(forms, [form.weights[style] + _RARE for form in forms])[0].text

    def prefix(self, kind: AssetKind) -> str:
        """Return the team's word for `kind`, lower case, if all of it and nothing else has it."""
        found = {name: _asset_parts(name)[0] for name in self._world.assets}
        own = {found[name] for name, spec in self._world.assets.items() if spec.kind == kind}
        other = {found[name] for name, spec in self._world.assets.items() if spec.kind != kind}
        word = own.pop() if len(own) == 1 else ""
        return "" if word in other or self.owners(word) or self.owners(word + "s") else word

    def teams(self, but: AssetKind | None = None) -> frozenset[str]:
        """Return the team's words for all its kinds, lower case, but for those of one kind."""
        assets = self._world.assets.items()
        return frozenset(_asset_parts(name)[0] for name, spec in assets if spec.kind != but)

    def _guessed(self, name: str) -> tuple[Form, ...]:
        """Return the forms of a name that the world does not have."""
        if not _NAME.fullmatch(name):
            return ()
        prefix = _asset_parts(name)[0]
        for own, spec in self._world.assets.items():
            if _asset_parts(own)[0] == prefix:
                return asset_forms(name, spec.kind)
        if any(part.isdigit() for part in parts_of(name)):
            return asset_forms(name, None)
        return place_forms(name, "gate" if _is_gate(parts_of(name)) else "post")


@lru_cache(maxsize=65_536)
def key_of(text: str) -> str:
    """Return `text` without the article, case and marks, so that equal keys sound the same."""
    words = "".join(c if c.isalnum() else " " for c in text.lower()).split()
    return "".join(words[1:] if words[:1] == ["the"] else words)


def parts_of(name: str) -> list[str]:
    """Return the words, letters and numbers that an identifier is made of."""
    return WORD.findall(name)


def number_word(number: int) -> str:
    """Return `number` as a word, as digits from twenty-one on."""
    return NUMBERS[number] if number < len(NUMBERS) else str(number)


def _asset_parts(name: str) -> tuple[str, str, str]:
    """Return the team's word, the letter and the digits of an asset's name, in lower case."""
    parts = [part.lower() for part in parts_of(name)]
    word = " ".join(part for part in parts if part.isalpha() and len(part) > 1)
    letter = next((part for part in parts if part.isalpha() and len(part) == 1), "")
    return word, letter, next((part for part in parts if part.isdigit()), "")


@lru_cache(maxsize=4096)
def asset_forms(name: str, kind: AssetKind | None) -> tuple[Form, ...]:
    """Return the forms of an asset's name; they may belong to others as well."""
    return tuple(_asset_forms(name, kind))


@lru_cache(maxsize=4096)
def place_forms(name: str, kind: str) -> tuple[Form, ...]:
    """Return the forms of a frame's or a zone's name; they may belong to others as well."""
    return tuple(_place_forms(name, kind))


def _asset_forms(name: str, kind: AssetKind | None) -> Iterator[Form]:
    """Yield the forms of an asset's name."""
    word, letter, digits = _asset_parts(name)
    yield Form(name, (6, 4, 3, 2))
    yield Form(f"FRAME_{name}", (0.15, 0.1, 0.05, 0.05))
    yield Form(" ".join(parts_of(name.replace("_", " "))), (0.2, 0.2, 0.2, 0.2))
    yield Form(name.replace("_", " "), (0.8, 0.8, 0.5, 0.8))
    yield Form(name.replace("_", "-"), (0.2, 0.2, 0.1, 0.2))
    if letter:
        spelt = " ".join((word.title(), _NATO[letter], *(_DIGITS[int(d)] for d in digits)))
        yield Form(spelt, (0.1, 0.05, 0.1, 2.5))
        yield Form(
            f"{word} {_NATO[letter].lower()}{f' {digits}' if digits else ''}", (0, 0, 0, 0.3)
        )
    if letter and digits:
        yield Form(f"{letter.upper()}{digits}", (0.5, 2, 0.7, 1))
        yield Form(f"{letter}{int(digits)}", (0.05, 0.6, 0.1, 0.05))
    if digits and word:
        number = int(digits)
        for noun, share in _nouns(word, kind):
            yield from _numbered(noun, number, share)
        yield Form(" ".join((word.title(), *(_DIGITS[int(d)] for d in digits))), (0, 0, 0.1, 1))
    elif word and letter:
        yield Form(f"{word} {letter.upper()}", (1, 1, 1, 0.5))


def _nouns(word: str, kind: AssetKind | None) -> Iterator[tuple[str, float]]:
    """Yield what stands before the number, with its share: mostly the team's own word."""
    yield word, 1.0
    for noun in (said for said, called in KIND_WORDS.items() if called == kind):
        if noun != word:
            yield noun, 0.12


def _numbered(noun: str, number: int, share: float) -> Iterator[Form]:
    """Yield the forms `drone 4`, `drone four` and so on."""
    listed = (
        (f"{noun} {number}", (3, 4, 4, 1.5)),
        (f"{noun.title()} {number}", (1.5, 0.8, 0.8, 1)),
        (f"{noun} {number_word(number)}", (1.5, 0.7, 3, 2)),
        (f"{noun}{number}", (0.1, 0.8, 0.2, 0)),
        (f"{noun} {number:02d}", (0.3, 0.5, 0.1, 0.4)),
        (f"{noun} no. {number}", (0.15, 0.05, 0.15, 0)),
        (f"{noun} number {number_word(number)}", (0.15, 0, 0.3, 0.1)),
        (f"{noun} #{number}", (0.1, 0.15, 0.1, 0)),
        (f"{noun}-{number}", (0.1, 0.2, 0.05, 0.1)),
    )
    for text, (plain, terse, chatty, radio) in listed:
        yield Form(text, (plain * share, terse * share, chatty * share, radio * share))


def _is_gate(parts: Iterable[str]) -> bool:
    return any(part.lower() in _GATE_WORDS for part in parts)


def _place_forms(name: str, kind: str) -> Iterator[Form]:
    """Yield the forms of a frame's or a zone's name."""
    parts = parts_of(name)
    words = " ".join(parts)
    low = words.lower()
    yield Form(name, (6, 5, 4, 2.5))
    yield Form(f"FRAME_{name}", (0.15, 0.1, 0.05, 0.05))
    stem = [part for part in parts if part.lower() not in _GATE_WORDS]
    if kind == "gate" and len(stem) < len(parts) and stem:
        yield from _gate_forms(parts, stem)
        return
    yield Form(f"the {low}", (3, 1, 5, 2))
    yield Form(low, (0.8, 2.5, 0.8, 2))
    yield Form(words, (0.8, 0.5, 0.5, 1.5))
    yield Form(f"the {words}", (0.6, 0.1, 0.6, 0.4))
    if kind == "base":
        yield Form("base", (1.5, 2.5, 1.5, 2))
        yield Form("the base", (1, 0.1, 1, 0.3))


def _gate_forms(parts: list[str], stem: list[str]) -> Iterator[Form]:
    """Yield `the east gate`, `gate east`, `east` for EastGate, `gate three` for Gate_3."""
    noun = next(part.lower() for part in parts if part not in stem)
    called = " ".join(stem)
    low = called.lower()
    if low.isdigit() or len(low) == 1:
        yield Form(f"{noun} {called}", (3, 3, 3, 2))
        yield Form(f"{noun.title()} {called}", (1, 0.5, 0.5, 1))
        if low.isdigit():
            yield Form(f"{noun} {number_word(int(low))}", (1, 0.5, 2, 2))
        else:
            yield Form(f"{noun} {_NATO[low].lower()}", (0.2, 0.2, 0.2, 2))
        return
    yield Form(f"the {low} {noun}", (4, 1, 6, 2))
    yield Form(f"{low} {noun}", (1.5, 3, 1.5, 2.5))
    yield Form(f"the {called} {noun.title()}", (1, 0.1, 1, 0.3))
    yield Form(f"{called} {noun.title()}", (1, 0.6, 0.6, 2))
    yield Form(f"the {called} {noun}", (0.6, 0.1, 0.6, 0.3))
    yield Form(f"{noun} {low}", (0.2, 0.5, 0.2, 0.8))
    yield Form(low, (0.3, 1.6, 0.6, 0.5))
    yield Form(called, (0.4, 0.6, 0.4, 0.5))
    for side in ("north", "south"):
        if low.startswith(side) and low != side and " " not in low:
            yield Form(f"the {side}-{low.removeprefix(side)} {noun}", (0.8, 0.1, 0.8, 0.3))
    if low in ("north", "east", "south", "west"):
        yield Form(f"{low[0].upper()} {noun}", (0.1, 0.7, 0.1, 0.1))
        yield Form(f"the {low}ern {noun}", (0.3, 0, 0.5, 0.1))
