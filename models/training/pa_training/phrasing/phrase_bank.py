"""Loads the phrase banks, and knows their keys and slots; part of a bank is never trained on."""

import hashlib
import random
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from types import MappingProxyType
from typing import Literal, NamedTuple, cast

from pa_console.schema.document import Document
from pa_training import LANGUAGE
from pa_training.phrasing.phrase_template import Template


class Slots(NamedTuple):
    """What a template may be filled with: it must use `needed`, and one of `either` if given."""

    needed: frozenset[str]
    allowed: frozenset[str]
    either: frozenset[str] = frozenset()


def _slots(words: str) -> Slots:
    """Read slots: `place` is needed, `track?` allowed, of `kind/kinds` at least one needed."""
    needed: set[str] = set()
    allowed: set[str] = set()
    either: set[str] = set()
    for word in words.split():
        if "/" in word:
            either.update(word.split("/"))
        elif word.endswith("?"):
            allowed.add(word[:-1])
        else:
            needed.add(word)
    return Slots(frozenset(needed), frozenset(needed | allowed | either), frozenset(either))


_LISTED = """
go.named = who place
go.kind = who place
look.named = who place track?
look.kind = who place track?
look.anyone = place track?
identify.named = who place track?
identify.kind = who place track?
identify.anyone = place track
warn.named = who place track?
warn.kind = who place track?
warn.anyone = place track
block.named = who place track?
block.kind = who place track?
block.anyone = place track?
respond.vehicle = place track
respond.person = place track
cover.failed = leaving place?
cover.bare = place
cover.kind = who place
relieve.named = who leaving place?
relieve.anyone = leaving place?
relieve.low = leaving place?
swap = a b
home.named = who base?
home.kind = who base?
home.low = who base?
stand_down = place
mass.all = place
mass.kind = who place
report.named = who
report.place = place
report.kind = who
report.all =
report.general =
hold.named = who
hold.all =
hold.leave =
others_stay =
except = who
strict_who = who
joiner = first second
joiner3 = first second third
opener.plain =
closer.plain =
opener.terse =
closer.terse =
opener.chatty =
closer.chatty =
opener.radio =
closer.radio =
who.kind.one = kind/kinds
who.kind.n = n kind/kinds
who.kind.all = kind/kinds
who.kind.origin = origin kind/kinds
who.kind.free = kind/kinds
noun.uav =
noun.ugv =
noun.robot =
noun.any =
noun.uav.plural =
noun.ugv.plural =
noun.robot.plural =
noun.any.plural =
noun.vehicle =
noun.track =
noun.person =
wrong.force = place track? who?
wrong.skip_identification.warn = place track? who?
wrong.skip_identification.block = place track? who?
wrong.skip_warning.block = place track? who?
wrong.override = clause
wrong.chase = place track who?
wrong.zone = zone who
wrong.noncombatants.identify = place track? who?
wrong.noncombatants.warn = place track? who?
wrong.noncombatants.block = place track? who?
wrong.strip = place
wrong.strip.all =
wrong.unknown_place = who gate_word?
wrong.incapable.drone_warn = who place track?
wrong.incapable.drone_block = who place track?
wrong.incapable.drone_identify = who place track?
wrong.incapable.robot_fly = who place track?
wrong.incapable.vehicle_fly = who place track?
wrong.incapable.robot_block = who place track?
wrong.incapable.vehicle_warn = who place track?
harmless.go = who place
harmless.look = who? place
harmless.identify = who? place
harmless.hold = who
harmless.home = who
harmless.report = who
aside = asset? place? thing?
inject = order asset? gate? base?
inject.only = asset? gate? base?
condition.track_at = place track
condition.no_track_at = place track
condition.authorized = place track
condition.unauthorized = place track
condition.hostile = place track
condition.uncovered = place
condition.covered = place
condition.low = asset
condition.not_low = asset
condition.down = asset
condition.up = asset
condition.free = kind
condition.none_free = kind/kinds
conditional.else = if then else
conditional.nothing = if then
conditional.then = if then
else_nothing =
"""


def _read(listed: str) -> Mapping[str, Slots]:
    pairs = (line.partition("=") for line in listed.strip().splitlines())
    return MappingProxyType({key.strip(): _slots(words) for key, _, words in pairs})


KEYS = _read(_LISTED)
"""Every key that a bank may have, with its slots."""


Style = Literal["plain", "terse", "chatty", "radio"]
Split = Literal["train", "heldout"]
STYLES: tuple[Style, ...] = ("plain", "terse", "chatty", "radio")
COMMON = 5
"""A word that so many templates use is no name when it stands alone."""
WORD_LISTS = "names.yaml"
"""The one file of the folder that holds no phrases but names for worlds."""
HELD_OUT = 0.15
"""The share of the templates of every key that training never sees."""

_ASKS = re.compile(
    r"\b(deal|handle|respon\w+|attend|see to|take care|look into|sort|check|do something|react|act"
    r"|find out|clear up|please|needs?|want|should|must)\b"
)
"""What makes of the words that something is there an order to do something about it."""


@dataclass(frozen=True)
class Entry:
    """A template of `key`, with the styles that it suits and the side it is on."""

    key: str
    template: Template
    styles: tuple[Style, ...]
    split: Split

    @cached_property
    def embeds(self) -> bool:
        """Whether it can stand within a longer sentence: one clause that does not end by itself."""
        source = self.template.source
        ends = any(mark in source for mark in ("?", "!", ". ", ": ", "; "))
        return not ends and (not self.key.startswith("respond.") or bool(_ASKS.search(source)))


class PhraseBank:
    """Every template by key."""

    def __init__(self, entries: Mapping[str, Sequence[Entry]]) -> None:
        """Keep `entries` by key; a key without any is one that nobody has worded."""
        self._entries = {key: tuple(listed) for key, listed in entries.items() if listed}

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that have wording."""
        return tuple(self._entries)

    def entries(self, key: str) -> tuple[Entry, ...]:
        """Return the templates of `key`; raises KeyError naming it when there are none."""
        if key not in self._entries:
            raise KeyError(f"no phrase bank has the key {key!r}")
        return self._entries[key]

    @cached_property
    def vocabulary(self) -> frozenset[str]:
        """The words that several templates use themselves, in lower case."""
        used = Counter(
            word
            for entries in self._entries.values()
            for entry in entries
            for word in entry.template.words
        )
        return frozenset(word for word, times in used.items() if times >= COMMON)

    def __contains__(self, key: str) -> bool:
        """Tell whether `key` has wording."""
        return key in self._entries

    def choose(  # noqa: PLR0917
        self,
        key: str,
        style: Style,
        split: Split,
        rng: random.Random,
        known: frozenset[str],
        wanted: frozenset[str] = frozenset(),
        embedded: bool = False,
    ) -> Template:
        """Return a template of `key` that needs no slot but those `known`.

        It keeps to `split`, then to wording with the slots `wanted`, then to what can be
        `embedded`, then to `style`, as long as something is left to choose from. Raises
        KeyError when nothing fits.
        """
        usable = [entry for entry in self.entries(key) if entry.template.always <= known]
        if not usable:
            raise KeyError(
                f"no phrase of {key!r} does with {', '.join(sorted(known)) or 'nothing'}"
            )
        usable = _narrowed(usable, lambda entry: entry.split == split)
        for slot in sorted(wanted, reverse=True):
            usable = _narrowed(usable, lambda entry, slot=slot: slot in entry.template.slots)
        usable = _narrowed(usable, lambda entry: entry.embeds or not embedded)
        return rng.choice(_narrowed(usable, lambda entry: style in entry.styles)).template


def _narrowed(entries: list[Entry], wish: Callable[[Entry], bool]) -> list[Entry]:
    """Return the entries that are as wished, or all when none is."""
    return [entry for entry in entries if wish(entry)] or entries


@cache
def phrase_bank() -> PhraseBank:
    """Return the banks of the repository; raises DocumentError."""
    folder = LANGUAGE
    texts = {
        part.name: part.read_text(encoding="utf-8")
        for part in sorted(folder.iterdir(), key=lambda part: part.name)
        if part.name.endswith(".yaml") and part.name != WORD_LISTS
    }
    return read_bank(texts)


def read_bank(texts: Mapping[str, str]) -> PhraseBank:
    """Return the bank that the YAML `texts`, by file name, make together.

    Raises DocumentError that names file, line, key and template.
    """
    styles: dict[str, dict[str, set[Style]]] = {}
    for name, text in texts.items():
        document = Document(name, text)
        for key, style, source in _listed(document):
            styles.setdefault(key, {}).setdefault(source, set()).update(style)
    sides = {key: _sides(key, sources) for key, sources in styles.items()}
    return PhraseBank(
        {
            key: [
                Entry(
                    key, Template(source), tuple(s for s in STYLES if s in its), sides[key][source]
                )
                for source, its in sources.items()
            ]
            for key, sources in styles.items()
        }
    )


def _listed(document: Document) -> Iterator[tuple[str, tuple[Style, ...], str]]:
    """Yield key, styles and template of everything in `document`, checked."""
    if not isinstance(document.value, dict):
        raise document.error((), "a phrase bank is a mapping of keys to templates")
    for key, value in cast("dict[object, object]", document.value).items():
        if not isinstance(key, str) or key not in KEYS:
            raise document.error((str(key),), "is not a known key; phrase_keys.py lists them")
        if isinstance(value, list):
            yield from _checked(document, key, "", cast("list[object]", value))
            continue
        if not isinstance(value, dict):
            raise document.error((key,), "must be a list, or a mapping of styles to lists")
        for style, templates in cast("dict[object, object]", value).items():
            if style not in STYLES or not isinstance(templates, list):
                problem = f"must be one of {', '.join(STYLES)} with a list of templates"
                raise document.error((key, str(style)), problem)
            yield from _checked(document, key, str(style), cast("list[object]", templates))


def _checked(
    document: Document, key: str, style: str, templates: list[object]
) -> Iterator[tuple[str, tuple[Style, ...], str]]:
    """Yield the `templates` of one key and style ("" for all); raises DocumentError."""
    where = (key, style) if style else (key,)
    for index, source in enumerate(templates):
        if not isinstance(source, str) or not source.strip():
            raise document.error((*where, index), f"{source!r} is not a text")
        problem = _problem(key, source)
        if problem:
            raise document.error((*where, index), f"{source!r}: {problem}")
        yield key, (cast("Style", style),) if style else STYLES, source


def _problem(key: str, source: str) -> str:
    """Return what is wrong with a template, or nothing."""
    try:
        template = Template(source)
    except ValueError as error:
        return str(error)
    slots = KEYS[key]
    if unknown := template.slots - slots.allowed:
        allowed = ", ".join(sorted(slots.allowed)) or "none"
        return f"unknown slot {', '.join(sorted(unknown))}; {key} knows: {allowed}"
    if missing := slots.needed - template.always:
        return f"every wording must have {{{'}, {'.join(sorted(missing))}}}"
    if slots.either and not template.slots & slots.either:
        return f"must have one of {', '.join(sorted(slots.either))}"
    return ""


def _sides(key: str, sources: Iterable[str]) -> dict[str, Split]:
    """Return the side of every template: by its words alone, but one at least is held out."""
    drawn = {source: _digest(key, source) for source in sources}
    first = min(drawn.values())
    most = max(HELD_OUT, first) if len(drawn) > 1 / HELD_OUT else HELD_OUT
    return {source: "heldout" if at <= most else "train" for source, at in drawn.items()}


def _digest(key: str, source: str) -> float:
    """Return a number from 0 to 1 that depends on the words alone."""
    return hashlib.sha256(f"{key}/{source}".encode()).digest()[0] / 256
