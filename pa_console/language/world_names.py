"""The names of a world by what operators call them, and which of them a text means."""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import lru_cache

from rapidfuzz import fuzz, process
from rapidfuzz.distance import OSA

from pa_console.schema.world import AssetKind, World

KIND_WORDS: dict[str, AssetKind] = {
    "drone": "uav",
    "uav": "uav",
    "ugv": "ugv",
    "vehicle": "ugv",
    "robot": "robot",
}
"""The words for an asset of a kind, under any name; the first of a kind is the plainest."""
GATE = "gate"
DIGITS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
_TEENS = ("thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen")
NUMBERS = (*DIGITS, "ten", "eleven", "twelve", *_TEENS, "twenty")
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_COMPASS = {"n": "north", "e": "east", "s": "south", "w": "west"}
_NUMBERED = re.compile(r"(.*?)(\d+)\D*")
_LONG = 5
"""The length from which a word may be misspelt by any slip; of one letter less, by a swap only."""


class WorldNames:
    """Assets by team and number, places by their words.

    A team is all assets whose names share a word, or all of a kind, or, without a word, all.
    """

    def __init__(self, places: Sequence[str], assets: Sequence[tuple[str, AssetKind]]) -> None:
        self._places = _places(places)
        self._stems = {key.removesuffix(GATE): name for key, name in self._places.items()}
        self._numbered: defaultdict[tuple[str, int], list[str]] = defaultdict(list)
        self._patterns: defaultdict[str, set[tuple[str, int]]] = defaultdict(set)
        self._kinds: dict[str, AssetKind] = {}
        own = {name: _team_word(name) for name, _ in assets}
        words = {*own.values()}
        for name, kind in assets:
            found = _NUMBERED.fullmatch(name)
            if found is None or not own[name]:
                continue
            generic = (word for word, called in KIND_WORDS.items() if called == kind)
            teams = {own[name], *(word for word in generic if word not in words)}
            self._kinds[own[name]] = kind
            for team in (*teams, ""):
                self._numbered[team, int(found[2])].append(name)
            for team in teams:
                self._patterns[team].add((found[1], len(found[2])))

    @classmethod
    def of(cls, world: World) -> "WorldNames":
        """Return the names of `world`, made once for all prompts and words typed."""
        assets = tuple((name, spec.kind) for name, spec in world.assets.items())
        return _made((*world.frames, *world.zones), assets)

    def is_place(self, name: str) -> bool:
        """Return whether `name` is a frame or a zone of more than one word."""
        return name in self._places.values()

    def place(self, words: Sequence[str]) -> str | None:
        """Return the place that `words`, in lower case, name: in full, from behind, or misspelt."""
        found = self._places.get("".join(words))
        if found is not None or len(words) != 2:
            return found
        if words[0] == GATE:
            return self._gate(words[1])
        if words[1] == GATE:
            found = self._gate(_COMPASS.get(words[0], words[0].removesuffix("ern")))
        if found is None and (words[1] == GATE or _is_gate_misspelt(words[1])):
            near = [name for stem, name in self._stems.items() if _nearly(words[0], stem)]
            found = near[0] if len(near) == 1 else None
        return found

    def gate_with(self, word: str) -> str | None:
        """Return the gate whose name is `word` and gate."""
        return self._stems.get(word)

    def team(self, word: str) -> str:
        """Return the team or kind that `word` is, also in the plural or misspelt; else nothing."""
        for said in (word, word.removesuffix("s")):
            if said in self._patterns:
                return said
        near = [team for team in self._patterns if _nearly(word, team)]
        return near[0] if len(near) == 1 and len(word) >= _LONG else ""

    def initial(self, letter: str) -> str:
        """Return the only team whose own word begins with `letter`, as of *D4*; else nothing."""
        found = [team for team in self._kinds if team.startswith(letter)]
        return found[0] if len(found) == 1 else ""

    def asset(self, team: str, number: int) -> str | None:
        """Return the asset of `team` with `number`, None for none or several."""
        found = self._numbered.get((team, number), [])
        return found[0] if len(found) == 1 else None

    def absent(self, team: str, number: int) -> str | None:
        """Return what an asset of `team` that is not there would be called, None if unclear."""
        patterns = [*self._patterns.get(team, ())]
        if (team, number) in self._numbered or len(patterns) != 1:
            return None
        prefix, width = patterns[0]
        return f"{prefix}{number:0{width}d}"

    def kind_word(self, word: str) -> str | None:
        """Return the plain word for the kind of the team `word`, None where it is no such word."""
        team = word.removesuffix("s")
        if team in KIND_WORDS or team not in self._kinds:
            return None
        plain = next(said for said, kind in KIND_WORDS.items() if kind == self._kinds[team])
        return plain + "s" * (team != word)

    def _gate(self, word: str) -> str | None:
        """Return the gate named by `word`, or by the number that it is."""
        if word in NUMBERS:
            word = str(NUMBERS.index(word))
        return self._places.get(word + GATE) or self._places.get(GATE + word)


@lru_cache(maxsize=8)
def _made(places: tuple[str, ...], assets: tuple[tuple[str, AssetKind], ...]) -> WorldNames:
    return WorldNames(places, assets)


def _places(names: Sequence[str]) -> dict[str, str]:
    """Return the places of more than one word, by their words in lower case."""
    words = {name: _parts_of(name) for name in names}
    return {"".join(said): name for name, said in words.items() if len(said) > 1}


def _team_word(name: str) -> str:
    return "".join(word for word in _parts_of(name) if len(word) > 1 and word.isalpha())


def _parts_of(name: str) -> list[str]:
    return [found.lower() for found in WORD.findall(name)]


def _nearly(word: str, other: str) -> bool:
    """Return whether one slip of the hand makes `other` of `word`."""
    shorter = min(len(word), len(other))
    if shorter < _LONG - 1 or abs(len(word) - len(other)) > 1 or OSA.distance(word, other) != 1:
        return False
    return shorter >= _LONG or sorted(word) == sorted(other)


def _is_gate_misspelt(word: str) -> bool:
    return "g" in word and set(word) <= set(GATE) and OSA.distance(word, GATE) == 1


NEARLY = 85.0
"""Least similarity of two words, of 100, for one to be a misspelling of the other."""
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")


def named(names: Iterable[str], text: str) -> list[str]:
    """Return the names that `text` contains, as they are or in words: `Drone_T01`, `drone T01`."""
    said = f" {' '.join(_plain_words(text))} "
    verbatim = {word.lower() for word in re.findall(r"\w+", text)}
    return [
        name
        for name in names
        if name.lower() in verbatim or f" {' '.join(_plain_words(name))} " in said
    ]


def names_meant(names: Iterable[str], text: str) -> list[str]:
    """Return the names whose own words `text` contains, those it contains wholly first.

    Words that most of the names share tell none of them from the others: of NorthGate and
    EastGate, "the north and east gates" means both. A word may be misspelled; a number may not.
    """
    parts = {name: _plain_words(name) for name in names}
    common = _common(parts.values())
    said = sorted({*_plain_words(text), *(word.lower() for word in re.findall(r"\w+", text))})
    found = {word: _is_said(word, said) for words in parts.values() for word in words}
    whole, partly = list[str](), list[str]()
    for name, words in parts.items():
        own = [word for word in words if word not in common] or words
        if name.lower() in said or all(found[word] for word in own):
            whole.append(name)
        elif any(found[word] and not word.isdigit() for word in own):
            partly.append(name)
    return whole or partly


def _plain_words(name: str) -> list[str]:
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
