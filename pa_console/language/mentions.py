"""Mentions in an order: places, assets, tracks, kinds, numbers and verbs.

Names are found by entity linking (`name_linking.py`). A mention either belongs to a request, or is
reported, quoted, addressed or ruled out: *the east gate is quiet, send a drone to the west gate*
requests nothing at the east gate, and *East gate, this is Watch* requests nothing there either. If
no clause of an order is a request, every clause counts as a request.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from pa_console.language.canonical.order import Task
from pa_console.language.lexicon import any_of, find_verbs, word_lists
from pa_console.language.name_linking import GATE, MEASURES, NUMBERS, WORD, WorldNames, link_names
from pa_console.schema.world import PLAIN_KINDS, AssetKind, World

Sort = Literal["place", "asset", "track", "kind", "number", "numeral", "verb"]
_COMPASS = {
    f"{word}{end}": word for word in ("north", "east", "south", "west") for end in ("", "ern")
}

KINDS: Mapping[str, AssetKind] = {
    word: kind for kind in PLAIN_KINDS for word in word_lists("kinds")[kind]
}
"""The words for kinds; *vehicle* may also mean a contact."""
ASSETS = frozenset(("asset", "unit", "machine", "device", "platform"))
"""The words for any asset."""
_ALL = frozenset(("all", "every", "each", "both", "everyone", "everybody", "everything"))
_NAMES = frozenset(("place", "asset", "track", "kind"))
_OF_SITES = re.compile(any_of("mentions", "of_sites"))
"""The pattern of the words for parts of any site, for texts in lower case."""
_LONGEST = 3
"""The largest number of words that are matched as one name."""
_SPELT = {
    word: word[0]
    for word in (
        *("alpha", "alfa", "bravo", "charlie", "delta", "echo", "foxtrot", "golf", "hotel"),
        *("india", "juliet", "kilo", "lima", "mike", "november", "oscar", "papa"),
    )
}
_CONTACTS = frozenset(word for words in word_lists("contacts").values() for word in words)
_AMOUNTS = frozenset(word_lists("names")["amounts"])
"""The words before an amount: *battery 9*, *speed 4*."""
_LEADS = frozenset(word_lists("mentions")["leads"])
_OWN = frozenset(word_lists("mentions")["own"])
"""The words that may come between *the* and a place whose name is a single word."""
_CAR = re.compile(r"(?:cars?|trucks?|vehicles?)")
_WORD = re.compile(r"[^\W_][\w-]*", re.UNICODE)
_QUOTED = re.compile(r"\"[^\"]*\"|“[^”]*”|```.*?```|(?<!\w)'[^']{3,}'(?!\w)|<[^<>]*>")
_MOST_QUOTED = 3
"""The largest number of words in quotation marks that may still be a name: "the east gate"."""
_CLAUSE = re.compile(r"[^.!?;,\n]+(?:\.(?=\w)[^.!?;,\n]*)*")
_REPORTED = re.compile(any_of("mentions", "told") + r"|['’](?:s|re|ve)\b", re.IGNORECASE)
_REQUEST = re.compile(any_of("mentions", "request") + r"|['’]d like", re.IGNORECASE)
_RULED_OUT = re.compile(
    r"(?:\b(?:not|never|no|nobody|without|instead of|rather than|except|forget|ignore|disregard)"
    r"|n['’]t)\b(?:(?!\b(?:but|and|only|then|just)\b).)*$",
    re.IGNORECASE,
)
_STATION = re.compile(r"\s*this is\b", re.IGNORECASE)
"""The words that follow the call signs of the addressees in a radio message."""
_MOST_ADDRESSED = 3
"""The largest number of words in a call sign."""
_STAYS_ON = re.compile(
    r"\band (?:then )?(?:just )?(?P<verb>hold|stay|wait|remain)\b"
    r"(?= *(?:$|(?:there|here|put|inside|outside|with (?:it|them|him|her)|until|till|for)\b))",
    re.IGNORECASE,
)
"""A request that adds nothing, because an asset stays where it is sent: *go to the gate and stay
there*."""
_IF = re.compile(
    r"\b(?:if|when|whether|unless|in case|provided|as long as|should|given that|suppose"
    r"|condition|once|otherwise|else)\b",
    re.IGNORECASE,
)


_PLACING = frozenset(("to", "at", "over", "towards", "toward", "tae"))
"""Prepositions after which one word of a place's name is enough: *two drones over Forge*."""


class Mention(NamedTuple):
    """Words of an order and their meaning: a name, a kind, a number or a verb.

    `requested` is False for words that are reported, quoted or ruled out, or that address a place
    by radio.
    """

    sort: Sort
    words: str
    means: str
    requested: bool = True
    tasks: frozenset[Task] = frozenset()
    """The tasks of a reading that account for a verb."""
    supports: frozenset[Task] = frozenset()
    """The tasks that a verb means."""
    quoted: bool = False
    """True inside a quotation of several words, which is not part of the order."""


class _MentionClause(NamedTuple):
    """The part of a text between two stops, and whether it is a request."""

    text: str
    asks: bool
    quoted: bool = False
    addressed: bool = False
    """True if it is a call sign at the start of a radio message."""

    def asks_about(self, start: int, sort: Sort) -> bool:
        """Return whether a mention of this `sort` that begins at `start` belongs to the request."""
        called = self.addressed and sort == "place"
        return self.asks and not called and not _RULED_OUT.search(self.text[:start])


def find_mentions(world: World, text: str, tracks: Iterable[str] = ()) -> tuple[Mention, ...]:
    """Return the mentions in `text` of things in `world` and of the `tracks` in sight.

    A word that looks like an asset's name (`Drone_T99`) counts as an asset, even if there is none.
    """
    finder = _Finder(world, tracks)
    return tuple(dict.fromkeys(finder.find(link_names(world, text))))


def without_quotations(text: str, instead: str = " ") -> str:
    """Return `text` with `instead` in place of each quotation of several words."""
    return _QUOTED.sub(lambda match: instead if _is_quotation(match[0]) else match[0], text)


def _is_quotation(quoted: str) -> bool:
    return len(_WORD.findall(quoted)) > _MOST_QUOTED


def speaks_of_site(world: World, text: str) -> bool:
    """Return whether `text` mentions a part of a site: place, asset, kind, post or contact.

    A passing mention counts, because the result is only used to exclude texts about other matters.
    """
    low, names = text.lower(), WorldNames.of(world)
    if _OF_SITES.search(low) or any(names.team(word) for word in re.findall("[a-z]+", low)):
        return True
    return any(mention.sort in _NAMES for mention in find_mentions(world, text))


class _Finder:
    """A finder of mentions in texts about one world."""

    def __init__(self, world: World, tracks: Iterable[str]) -> None:
        self._sorts: dict[str, tuple[Sort, str]] = {}
        for name in tracks:
            self._sorts[name.lower()] = ("track", name)
        for name in world.assets:
            self._sorts[name.lower()] = ("asset", name)
        places = [*world.frames, *world.zones]
        for name in places:
            self._sorts[name.lower()] = ("place", name)
        self._squashed = {_squashed(name): meaning for name, meaning in self._sorts.items()}
        self._parts = _own_words(places)
        self._plain = {name.lower() for name in world.frames if len(WORD.findall(name)) == 1}
        """The frames whose name is a single word: *base*, *checkpoint*."""
        self._compass = {
            word: self._parts[whole] for word, whole in _COMPASS.items() if whole in self._parts
        }

    def find(self, text: str) -> Iterator[Mention]:
        for clause in _clauses(text):
            quoted = clause.quoted and _is_quotation(clause.text)
            yield from (mention._replace(quoted=quoted) for mention in self._of(clause))

    def _of(self, clause: _MentionClause) -> Iterator[Mention]:
        words = [(match[0], match.start()) for match in _WORD.finditer(clause.text)]
        assets, others = set[int](), set[int]()
        for at, (word, start) in enumerate(words):
            low = word.lower().removeprefix("frame_")
            if low in self._plain and self._is_another(words, at):
                place = f"{words[at - 1][0]} {word}"
                yield Mention("place", place, place, clause.asks_about(start, "place"))
                others.add(start)
            elif match := self._sorts.get(low):
                sort, means = match
                yield Mention(sort, word, means, clause.asks_about(start, sort))
                assets.update((at,) if sort == "asset" else ())
            elif _is_name(word):
                yield Mention("asset", word, word, clause.asks_about(start, "asset"))
            elif whole := self._spelt(words, at):
                sort, means = whole
                yield Mention(sort, word, means, clause.asks_about(start, sort))
                assets.update((at,) if sort == "asset" else ())
            elif low in self._compass:
                requested = clause.asks_about(start, "place")
                yield Mention("place", word, self._compass[low], requested)
            elif low in self._parts:
                led = at > 0 and words[at - 1][0].lower() in _PLACING
                requested = led and clause.asks_about(start, "place")
                yield Mention("place", word, self._parts[low], requested)
            elif (number := _numeral(low)) and not _counts(clause.text, words, at):
                yield Mention("numeral", word, number, False)
        yield from _kinds(words, assets, clause)
        stays_on = {match.start("verb") for match in _STAYS_ON.finditer(clause.text)}
        sent = False
        for verb in find_verbs(clause.text):
            if verb.start in others:
                continue
            plain = verb.plain and clause.asks_about(verb.start, "verb")
            plain = plain and not (sent and verb.start in stays_on)
            sent = sent or "go" in verb.tasks
            yield Mention("verb", verb.word, verb.word, plain, verb.tasks, verb.means)

    def _is_another(self, words: Sequence[tuple[str, int]], at: int) -> bool:
        """Return whether the word before the name makes it an unknown place: *the moon base*."""
        if at < 2 or words[at - 2][0].lower() not in _LEADS:
            return False
        before = words[at - 1][0].lower()
        other_words = (
            _LEADS | _OWN | KINDS.keys() | ASSETS | self._sorts.keys() | self._parts.keys()
        )
        if before in other_words or before in _COMPASS or not before.isalpha() or before in NUMBERS:
            return False
        return not before.endswith(("est", "ly")) and not any(find_verbs(before))

    def _spelt(self, words: Sequence[tuple[str, int]], at: int) -> tuple[Sort, str] | None:
        """Return the meaning of a name spelt in several words: `Gate Charlie`, `harpy-b`."""
        for end in range(min(at + _LONGEST, len(words)), at, -1):
            spelt = [word for word, _ in words[at:end]]
            meaning = self._squashed.get(_squashed(" ".join(_letter(word) for word in spelt)))
            if meaning is not None:
                return meaning
        return None


def _letter(word: str) -> str:
    return _SPELT.get(word.lower(), word)


def _squashed(name: str) -> str:
    return re.sub(r"[\W_]", "", name).lower()


def _clauses(text: str) -> list[_MentionClause]:
    """Return the clauses of `text`, quoted ones first."""
    quoted = [_MentionClause(match[0], asks=False, quoted=True) for match in _QUOTED.finditer(text)]
    parts = [match[0] for match in _CLAUSE.finditer(_QUOTED.sub(" , ", text)) if match[0].strip()]
    addressed = _addressed(parts)
    asks = [_asks(part) for part in parts]
    if not any(asks):
        asks = [True] * len(parts)
    requests = zip(parts, asks, strict=True)
    return [
        *quoted,
        *(
            _MentionClause(part, ask, addressed=at < addressed)
            for at, (part, ask) in enumerate(requests)
        ),
    ]


def _addressed(parts: Sequence[str]) -> int:
    """Return the number of clauses at the start that are call signs: *Plaza, this is Watch*."""
    for at, part in enumerate(parts):
        if _STATION.match(part):
            return at
        if len(part.split()) > _MOST_ADDRESSED:
            break
    return 0


def _asks(clause: str) -> bool:
    """Return whether a clause is a request: it has a verb of requests, or no sign of a report."""
    if _REQUEST.search(clause) or any(verb.plain for verb in find_verbs(clause)):
        return True
    return not _REPORTED.search(clause)


def _kinds(
    words: Sequence[tuple[str, int]], assets: set[int], clause: _MentionClause
) -> Iterator[Mention]:
    """Yield the mentioned kinds, and the requested numbers of a kind or of all assets."""
    for at, (word, start) in enumerate(words):
        requested = clause.asks_about(start, "kind")
        kind = KINDS.get(word.lower()) or KINDS.get(word.lower().removesuffix("s"))
        after = words[at + 1][0].lower() if at + 1 < len(words) else ""
        if kind == "robot" and _CAR.fullmatch(after):
            kind = "ugv"
        if kind is None and word.lower().removesuffix("s") not in ASSETS:
            continue
        if kind is not None and at + 1 not in assets:
            yield Mention("kind", word, kind, requested)
        count = _counted([before.lower() for before, _ in words[max(at - 5, 0) : at]])
        if count:
            yield Mention("number", f"{count} {word}", count, requested)
    for word, _ in words:
        if word.lower() in ("everyone", "everybody", "everything"):
            yield Mention("number", word, "all", False)


def _counted(before: Sequence[str]) -> str:
    """Return the number that the words `before` a noun give it: a number, `all`, or ''."""
    for word in reversed(before):
        if word in _ALL:
            return "2" if word == "both" else "all"
        if word in NUMBERS[1:]:
            return str(NUMBERS.index(word))
        if word.isdigit():
            return str(int(word)) if len(word) < 3 and int(word) < len(NUMBERS) else ""
        if word in KINDS or word in ("and", "with", "to", "at", "for", "a", "an", "no", "than"):
            return ""
    return ""


def _numeral(word: str) -> str:
    """Return the number that `word` is or ends with, as in `t05`; '' if there is none."""
    if word in NUMBERS:
        return str(NUMBERS.index(word))
    match = re.fullmatch(r"[a-z]*?0*(\d{1,4})", word)
    return match[1] if match is not None else ""


def _counts(text: str, words: Sequence[tuple[str, int]], at: int) -> bool:
    """Return whether the word at `at` is a number that belongs to no asset.

    It may count the next noun, be an amount (*9 pct*, *battery 9*), or belong to a contact (*van
    3*).
    """
    word, start = words[at]
    if not word.isalpha() and not word.isdecimal():
        return False
    after = [next_word.lower() for next_word, _ in words[at + 1 : at + 4]]
    before = words[at - 1][0].lower() if at else ""
    if (after[:1] and after[0] in MEASURES) or text[start + len(word) :].lstrip().startswith("%"):
        return True
    if before in _AMOUNTS or before.removesuffix("s") in _CONTACTS - KINDS.keys() - {"vehicle"}:
        return True
    nouns = (next_word.removesuffix("s") for next_word in after)
    return word.isalpha() and any(next_word in KINDS or next_word in ASSETS for next_word in nouns)


def _is_name(word: str) -> bool:
    """Return whether a word looks like an asset's name: letters, an underscore and a number."""
    return re.fullmatch(r"[A-Za-z]+_[A-Z]?\d+", word) is not None


def _own_words(places: Sequence[str]) -> dict[str, str]:
    """Map each word that is in the name of only one place to that place: `north` to NorthGate."""
    places_by_word: dict[str, list[str]] = {}
    for name in places:
        words = [word.lower() for word in WORD.findall(name)]
        for word in words if len(words) > 1 else ():
            places_by_word.setdefault(word, []).append(name)
    return {
        word: names[0]
        for word, names in places_by_word.items()
        if len(names) == 1 and word.isalpha() and len(word) > 2 and word != GATE
    }
