"""Entity linking, which replaces words by the names that they mean: `uav four` by Drone_T04.

A small model understands the exact name far better than the operator's words for it. Words are
replaced only if they can mean just one thing; all other words are left to the model. All names come
from the world; `WorldNames` finds them by the words that operators use.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

from rapidfuzz import fuzz, process
from rapidfuzz.distance import OSA

from pa_console.language.lexicon import word_lists
from pa_console.schema.world import AssetKind, World

KIND_WORDS: dict[str, AssetKind] = {
    "drone": "uav",
    "uav": "uav",
    "ugv": "ugv",
    "vehicle": "ugv",
    "robot": "robot",
}
"""The words for assets of each kind, in any world; the first word of each kind is the plainest."""
GATE = "gate"
DIGITS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
_TEENS = ("thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen")
NUMBERS = (*DIGITS, "ten", "eleven", "twelve", *_TEENS, "twenty")
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_COMPASS = {"n": "north", "e": "east", "s": "south", "w": "west"}
_NUMBERED = re.compile(r"(.*?)(\d+)\D*")
_LONG = 5
"""The length from which a word may have any misspelling; in a word one letter shorter, only two
swapped letters are allowed."""

_GATE_WORDS = frozenset((GATE, "entrance"))

NEARLY = 85.0
"""The least similarity, in percent, at which one word counts as a misspelling of another."""
_PLAIN_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_a-zA-Z]+")

_WORDS = word_lists("names")
_BEFORE_NUMBER = frozenset(_WORDS["before_number"])
_AND = frozenset((",", "and", "&", "/", "+", "or", "plus"))
MEASURES = frozenset(_WORDS["measures"])
_DETERMINERS = frozenset(_WORDS["determiners"])
_TOKEN = re.compile(rf"{WORD.pattern}|[,&/+]")
_ARTICLES = re.compile(r"\b(?:the )+$")
_JOINTS = frozenset(("", " ", "-", "_", " #", "#"))
"""The separators between the words of one name; after an abbreviation, a dot may precede them."""
_LONGEST = 4
"""The largest number of words that are matched as one name."""
_MOST_DIGITS = 4


class WorldNames:
    """The names of a world: assets by team and number, places by their words.

    A team consists of all assets whose names share a word, or all of a kind. The empty word means
    the team of all assets.
    """

    def __init__(
        self,
        places: Sequence[str],
        assets: Sequence[tuple[str, AssetKind]],
        aliases: Sequence[tuple[str, str]] = (),
    ) -> None:
        self._aliases = {tuple(words.split()): name for words, name in aliases}
        self._places = _places(places)
        self._stems = {stem: name for name in places if (stem := _stem(name))}
        self._numbered: defaultdict[tuple[str, int], list[str]] = defaultdict(list)
        self._patterns: defaultdict[str, set[tuple[str, int]]] = defaultdict(set)
        self._kinds: dict[str, AssetKind] = {}
        own = {name: _team_word(name) for name, _ in assets}
        words = {*own.values()}
        for name, kind in assets:
            numbered = _NUMBERED.fullmatch(name)
            if numbered is None or not own[name]:
                continue
            generic = (word for word, named_kind in KIND_WORDS.items() if named_kind == kind)
            teams = {own[name], *(word for word in generic if word not in words)}
            self._kinds[own[name]] = kind
            for team in (*teams, ""):
                self._numbered[team, int(numbered[2])].append(name)
            for team in teams:
                self._patterns[team].add((numbered[1], len(numbered[2])))

    @classmethod
    def of(cls, world: World) -> "WorldNames":
        """Return the names of `world`, which are built once and cached."""
        assets = tuple((name, spec.kind) for name, spec in world.assets.items())
        return _made((*world.frames, *world.zones), assets, tuple(world.aliases.items()))

    def called(self, words: Sequence[str]) -> str | None:
        """Return the name with the alias `words` (in lower case); None if there is none."""
        return self._aliases.get(tuple(words))

    def is_place(self, name: str) -> bool:
        """Return whether `name` is a frame or a zone of more than one word."""
        return name in self._places.values()

    def place(self, words: Sequence[str]) -> str | None:
        """Return the place that `words`, in lower case, name: in full, in reverse, or misspelt."""
        place = self._places.get("".join(words))
        if place is not None or len(words) != 2:
            return place
        if words[0] == GATE:
            return self._gate(words[1])
        if words[1] == GATE:
            place = self._gate(_COMPASS.get(words[0], words[0].removesuffix("ern")))
        if place is None and (words[1] == GATE or _is_gate_misspelt(words[1])):
            near = [name for stem, name in self._stems.items() if _nearly(words[0], stem)]
            place = near[0] if len(near) == 1 else None
        return place

    def gate_with(self, word: str) -> str | None:
        """Return the gate whose name consists of `word` and *gate*."""
        return self._stems.get(word)

    def team(self, word: str) -> str:
        """Return the team or kind that `word` names, even if plural or misspelt; '' for none."""
        for candidate in (word, word.removesuffix("s")):
            if candidate in self._patterns:
                return candidate
        near = [team for team in self._patterns if _nearly(word, team)]
        return near[0] if len(near) == 1 and len(word) >= _LONG else ""

    def initial(self, letter: str) -> str:
        """Return the only team whose own word begins with `letter`, as in *D4*; '' for none."""
        teams = [team for team in self._kinds if team.startswith(letter)]
        return teams[0] if len(teams) == 1 else ""

    def asset(self, team: str, number: int) -> str | None:
        """Return the asset of `team` with `number`; None if there is no such asset, or several."""
        assets = self._numbered.get((team, number), [])
        return assets[0] if len(assets) == 1 else None

    def absent(self, team: str, number: int) -> str | None:
        """Return the name of an asset that `team` lacks; None if its name would be unclear."""
        patterns = [*self._patterns.get(team, ())]
        if (team, number) in self._numbered or len(patterns) != 1:
            return None
        prefix, width = patterns[0]
        return f"{prefix}{number:0{width}d}"

    def kind_word(self, word: str) -> str | None:
        """Return the plain word for the kind of the team `word`; None if it is no team's word."""
        team = word.removesuffix("s")
        if team in KIND_WORDS or team not in self._kinds:
            return None
        plain = next(generic for generic, kind in KIND_WORDS.items() if kind == self._kinds[team])
        return plain + "s" * (team != word)

    def _gate(self, word: str) -> str | None:
        """Return the gate that `word` names, which may be a number; None if it names no gate."""
        if word in NUMBERS:
            word = str(NUMBERS.index(word))
        return self._places.get(word + GATE) or self._places.get(GATE + word)


@lru_cache(maxsize=8)
def _made(
    places: tuple[str, ...],
    assets: tuple[tuple[str, AssetKind], ...],
    aliases: tuple[tuple[str, str], ...],
) -> WorldNames:
    return WorldNames(places, assets, aliases)


def _places(names: Sequence[str]) -> dict[str, str]:
    """Return the places of more than one word, by their words in lower case."""
    words = {name: _parts_of(name) for name in names}
    return {"".join(parts): name for name, parts in words.items() if len(parts) > 1}


def _stem(name: str) -> str:
    """Return the word that identifies a gate: `yew` for GateYew; '' if there is none."""
    parts = _parts_of(name)
    own = [part for part in parts if part not in _GATE_WORDS]
    stem = "".join(own)
    return stem if len(own) < len(parts) and stem.isalpha() and len(stem) > 1 else ""


def _team_word(name: str) -> str:
    return "".join(word for word in _parts_of(name) if len(word) > 1 and word.isalpha())


def _parts_of(name: str) -> list[str]:
    return [part.lower() for part in WORD.findall(name)]


def _nearly(word: str, other: str) -> bool:
    """Return whether one typing slip turns `word` into `other`."""
    shorter = min(len(word), len(other))
    if shorter < _LONG - 1 or abs(len(word) - len(other)) > 1 or OSA.distance(word, other) != 1:
        return False
    return shorter >= _LONG or sorted(word) == sorted(other)


def _is_gate_misspelt(word: str) -> bool:
    return "g" in word and set(word) <= set(GATE) and OSA.distance(word, GATE) == 1


def named(names: Iterable[str], text: str) -> list[str]:
    """Return the names that `text` contains, verbatim or in words: `Drone_T01`, `drone T01`."""
    plain_text = f" {' '.join(_plain_words(text))} "
    verbatim = {word.lower() for word in re.findall(r"\w+", text)}
    return [
        name
        for name in names
        if name.lower() in verbatim or f" {' '.join(_plain_words(name))} " in plain_text
    ]


def names_meant(names: Iterable[str], text: str) -> list[str]:
    """Return the names whose own words `text` contains, or partial matches if no name is complete.

    Words that most of the names share do not distinguish them: of NorthGate and EastGate, "the
    north and east gates" means both. A word may be misspelt; a number may not.
    """
    parts = {name: _plain_words(name) for name in names}
    common = _common(parts.values())
    text_words = sorted({*_plain_words(text), *(word.lower() for word in re.findall(r"\w+", text))})
    matched = {word: _is_said(word, text_words) for words in parts.values() for word in words}
    whole, partly = list[str](), list[str]()
    for name, words in parts.items():
        own = [word for word in words if word not in common] or words
        if name.lower() in text_words or all(matched[word] for word in own):
            whole.append(name)
        elif any(matched[word] and not word.isdigit() for word in own):
            partly.append(name)
    return whole or partly


def _plain_words(name: str) -> list[str]:
    """Return the words of a name or text: those of `NorthGate_2` are north, gate, 2."""
    return [word.lower() for word in _PLAIN_WORD.findall(name)]


def _common(names: Iterable[list[str]]) -> set[str]:
    listed = [set(words) for words in names]
    every = {word for words in listed for word in words}
    return {
        word
        for word in every
        if len(listed) > 1 and sum(word in words for words in listed) > len(listed) / 2
    }


def _is_said(word: str, text_words: list[str]) -> bool:
    if word in text_words:
        return True
    if len(word) < 4 or not word.isalpha():
        return False
    return process.extractOne(word, text_words, scorer=fuzz.ratio, score_cutoff=NEARLY) is not None


class _NameToken(NamedTuple):
    word: str
    start: int
    end: int


class _Link(NamedTuple):
    """The tokens from `first` to `end`, which mean `name`."""

    first: int
    end: int
    name: str


def link_names(world: World, text: str) -> str:
    """Return `text` with the assets and places of `world` under their own names."""
    return LinkedText.of(world, text).text


class LinkedText(NamedTuple):
    """A text in which names replace other words, and the ranges of these words in the `original`.

    `names` has the first and last character of each range, and the name that replaces it.
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
        """The text with its names in place of other words."""
        parts, done = list[str](), 0
        for start, end, name in self.names:
            parts += [self.original[done:start], name]
            done = end
        return "".join((*parts, self.original[done:]))

    def original_words(self, start: int, end: int) -> str:
        """Return the original words for the characters from `start` to `end` of the text."""
        return self.original[self._before(start, last=False) : self._before(end, last=True)]

    def _before(self, at: int, *, last: bool) -> int:
        """Return the position in the original of the character `at` of the text.

        Within a name, it is the start of the replaced range or, with `last`, its end.
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
    """A linker of the words of one text with the names of one world."""

    def __init__(self, names: WorldNames, text: str) -> None:
        self._names, self._text = names, text
        self._tokens = [
            _NameToken(match.group().lower(), match.start(), match.end())
            for match in _TOKEN.finditer(text)
        ]
        self._linked = 0
        """The end of the latest link."""

    def links(self) -> Iterator[_Link]:
        """Yield the replacements, from left to right."""
        at = 0
        while at < len(self._tokens):
            links = [*self._longest(at, self._names.called)] or [*self._gates(at)]
            links = links or [*self._longest(at, self._names.place)]
            links = links or [*self._assets(at)] or [*self._kind(at)]
            if links and all(map(self._whole, links)):
                yield from links
                self._linked = links[-1].end
            at = max(at + 1, self._linked)

    def _whole(self, link: _Link) -> bool:
        """Return whether `link` has only whole words: not `gate North` in `gate NorthGate`.

        The `s gate` of `its owner's gate` does not mean the south gate either.
        """
        start, end = self.span(link)
        if self._word(link.first) == "s" and self._text[max(start - 1, 0) : start] in ("'", "’"):
            return False
        around = self._text[max(start - 1, 0) : start] + self._text[end : end + 1]
        return not re.search(r"\w", around)

    def span(self, link: _Link) -> tuple[int, int]:
        """Return the range of the characters of `link`, including an article before it."""
        start, end = self._tokens[link.first].start, self._tokens[link.end - 1].end
        before = self._text[:start].lower()
        if before.endswith("frame_"):
            start -= len("frame_")
        elif self._names.is_place(link.name) and (article := _ARTICLES.search(before)):
            start = article.start()
        return start, end

    def _gates(self, at: int) -> Iterator[_Link]:
        """Yield the gates of a list at `at`, such as `north, east and the west gate`."""
        gates: list[_Link] = []
        while name := self._names.gate_with(self._word(at)):
            gates.append(_Link(at, at + 1, name))
            at = self._after_and(at + 1)
        if len(gates) > 1 and self._word(at) in (GATE, f"{GATE}s"):
            yield from (*gates[:-1], gates[-1]._replace(end=at + 1))

    def _longest(self, at: int, find: Callable[[Sequence[str]], str | None]) -> Iterator[_Link]:
        """Yield the longest name that `find` returns for the words from token `at` on."""
        for end in range(min(at + _LONGEST, len(self._tokens)), at, -1):
            words = [token.word for token in self._tokens[at:end]]
            name = find(words) if self._together(at, end) else None
            if name is not None:
                yield _Link(at, end, name)
                return

    def _assets(self, at: int) -> Iterator[_Link]:
        """Yield the asset named at `at`, and assets of the same team that are listed after it."""
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
        """Return whether digits follow token `at` without a space, as in `D4`."""
        end = self._tokens[at].end
        return self._text[end : end + 1].isdigit()

    def _kind(self, at: int) -> Iterator[_Link]:
        """Yield the plain word of a kind in place of a team's word: *a drone* for *a firefly*."""
        before, plain = self._word(at - 1), self._names.kind_word(self._word(at))
        if plain is not None and before == "an":
            yield _Link(at - 1, at + 1, f"a {plain}")
        elif plain is not None and (before in _DETERMINERS or before.isdigit()):
            yield _Link(at, at + 1, plain)

    def _number(self, at: int) -> tuple[int, int | None]:
        """Return the end and the value of the number at token `at`, if there is one."""
        while self._word(at) in _BEFORE_NUMBER and self._together(at - 1, at + 1):
            at += 1
        word, digits = self._word(at), ""
        if self._word(at - 1) not in _AND and not self._together(max(at - 1, 0), at + 1):
            return at, None
        if word.isdigit():
            at, digits = at + 1, word
        elif word in NUMBERS[len(DIGITS) :]:
            at, digits = at + 1, str(NUMBERS.index(word))
        while self._word(at) in DIGITS and digits in ("", "0") and not word.isdigit():
            at, digits = at + 1, digits + str(DIGITS.index(self._word(at)))
        amount = self._text[self._tokens[at - 1].end :].lstrip().startswith("%")
        fits = not amount and 0 < len(digits) <= _MOST_DIGITS and self._word(at) not in MEASURES
        return at, int(digits) if fits else None

    def _counted(self, at: int) -> bool:
        """Return whether there is a number before token `at`, as in `two drones`."""
        before = self._word(at - 1)
        return at != self._linked and (before in NUMBERS or before.isdigit())

    def _after_and(self, at: int) -> int:
        """Return the first token from `at` on that is no comma, `and` or `and the`."""
        first = at
        while self._word(at) in _AND or (at > first and self._word(at) == "the"):
            at += 1
        return at

    def _word(self, at: int) -> str:
        return self._tokens[at].word if 0 <= at < len(self._tokens) else ""

    def _together(self, first: int, end: int) -> bool:
        """Return whether the tokens have only the separators of a name between them."""
        pairs = pairwise(self._tokens[first:end])
        return end <= len(self._tokens) and all(self._joined(*pair) for pair in pairs)

    def _joined(self, token: _NameToken, following: _NameToken) -> bool:
        gap = self._text[token.end : following.start]
        return (gap.removeprefix(".") if token.word in _BEFORE_NUMBER else gap) in _JOINTS
