"""The words of orders that refer to earlier orders, and the results of resolving such orders.

`following_orders.py` completes whole orders, such as *same for north*; `pronouns.py` replaces *it*
and *there*.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pa_console.language.canonical.order import STILL_TASKS
from pa_console.language.lexicon import any_of, find_verbs, word_lists
from pa_console.language.mentions import find_mentions
from pa_console.language.references.reader import (
    CONTACTS,
    Reader,
    asset_at,
    place_at,
    read_tokens,
)
from pa_console.language.references.scene import Move, PastMission, ReferenceScene
from pa_console.schema.command import STILL

_WORDS = word_lists("conversation")
_CORRECTING = frozenset(_WORDS["correcting"])
_CORRECTING_PHRASES = _WORDS["correcting_phrases"]
UNDOING = _WORDS["undoing"]
SAME = frozenset(_WORDS["same"])
THERE = _WORDS["there"]
IT = _WORDS["it"]
THEM = _WORDS["them"]
THEY = _WORDS["they"]
LEANING = frozenset((*IT, *THEM, *THEY, *THERE, *SAME))
"""The words that refer to an earlier order."""
_WELL = frozenset(_WORDS["well"])
"""Words that ask about the condition of an asset."""
HOME = frozenset(_WORDS["home"])
_SHORT = 11
"""The largest number of words in an order that may be incomplete."""
_OWN_TASKS = frozenset(("report", "identify", "warn", "block", "look", "hold", "relieve", "swap"))
_PUTTING = frozenset(("go", "mass", "cover", "home"))
MOST_CORRECTING = 16
"""The largest number of words in a correction; a longer text is an order of its own."""
_BEGINNING = (*_CORRECTING_PHRASES, "i meant", "i mean", "not that", "not the", "rather the")
_STILL_LEANING = frozenset(_WORDS["still_leaning"])
_ANYONE = frozenset(("somebody", "someone", "anybody", "anyone", "anything", *CONTACTS))
_EVERY = re.compile(any_of("mention_check", "every"))


@dataclass(frozen=True)
class ResolvedReference:
    """Words of a text, with their range of characters and their meaning.

    `becomes` is the replacement if it differs from the names in `means`.
    """

    start: int
    end: int
    words: str
    means: str
    becomes: str = ""

    @property
    def written(self) -> str:
        """The words that replace the reference."""
        return self.becomes or self.means


@dataclass(frozen=True)
class Unclear:
    """Words that fit several things or none, with the question to ask and the possible answers."""

    words: str
    question: str
    choices: tuple[str, ...] = ()
    describes: bool = False
    """True if the words describe an asset or point at one, so that a model may know which."""


@dataclass(frozen=True)
class NameInOrder:
    """A name in an order, its range of tokens, and whether it is excluded: *not the hub*."""

    name: str
    at: int
    end: int
    ruled_out: bool


@dataclass(frozen=True)
class ResolvedOrder:
    """An order after resolution: its `text`, and each replaced reference with its meaning.

    It may take back the last order (`undoes`) or replace it (`corrects`).
    """

    text: str
    meanings: tuple[tuple[str, str], ...] = ()
    undoes: bool = False
    corrects: bool = False


def substituted(text: str, references: Sequence[ResolvedReference]) -> str:
    """Return `text` with every reference in `references` replaced; they must not overlap."""
    parts, done = list[str](), 0
    for reference in sorted(references, key=lambda item: item.start):
        parts += [text[done : reference.start], reference.written]
        done = reference.end
    return "".join((*parts, text[done:]))


def corrects(text: str) -> Literal["replaces", "takes back", ""]:
    """Return whether a text corrects the previous order or takes it back; '' for any other text.

    *No, the other gate* corrects it, and *never mind* takes it back; such words must come first.
    """
    words = [token.word for token in read_tokens(text) if token.word[0].isalnum()]
    sentence = f" {' '.join(words)} "
    if len(words) > MOST_CORRECTING or not words:
        return ""
    undone = next((phrase for phrase in UNDOING if sentence.startswith(f" {phrase} ")), "")
    if undone and len(words) <= len(undone.split()) + 1:
        return "takes back"
    begins = words[0] in _CORRECTING - {"change", "rather", "mean", "not"}
    begins = begins or any(sentence.startswith(f" {phrase} ") for phrase in (*_BEGINNING, *UNDOING))
    return "replaces" if begins else ""


def leaning_words(scene: ReferenceScene, text: str) -> tuple[str, ...]:
    """Return the words of a resolved order that still refer to the previous one.

    Their meaning was not found, so a model that sees only this order has to guess.
    """
    if scene.last is None:
        return ()
    return tuple(dict.fromkeys(t.written for t in read_tokens(text) if t.word in _STILL_LEANING))


def leans(scene: ReferenceScene, text: str) -> bool:
    """Return whether an order may need the previous one, because it lacks an asset or a place.

    *Home*, *hold* and *report* need no place; *anybody* counts as an asset, and a visitor as a
    place.
    """
    if leaning_words(scene, text):
        return True
    mentions = find_mentions(scene.world, text, scene.picture.tracks)
    sorts = {mention.sort for mention in mentions}
    tasks = {task for mention in mentions for task in mention.supports}
    somewhere = sorts & {"place", "track"} or tasks & (STILL_TASKS | {"home"})
    words = {token.word for token in read_tokens(text)}
    anyone = sorts & {"asset", "kind"} or words & _ANYONE or _EVERY.search(text.lower())
    return not (anyone and somewhere)


class Turn:
    """The words of an order that follows others, and the last mission that moved an asset."""

    def __init__(self, scene: ReferenceScene, text: str) -> None:
        self.scene, self.text, self.tokens = scene, text, read_tokens(text)
        self.last = scene.last or PastMission("", ())
        self.moves = [move for move in self.last.moves if move.verb not in STILL]
        self.movers = list(dict.fromkeys(move.agent for move in self.moves))
        self.words = [token.word for token in self.tokens]
        self.plain = f" {' '.join(word for word in self.words if word[0].isalnum())} "
        """The words in lower case without punctuation, each between spaces."""
        self.assets, self.places = self._names()

    def _names(self) -> tuple[list[NameInOrder], list[NameInOrder]]:
        assets, places = list[NameInOrder](), list[NameInOrder]()
        at = 0
        while at < len(self.tokens):
            reader = Reader(self.tokens, at)
            if name := asset_at(self.scene, reader):
                assets.append(NameInOrder(name, at, reader.at, self.ruled_out(at)))
                standing = Reader(self.tokens, reader.at)
                if standing.take("at") and place_at(self.scene, standing) == self._at_place(name):
                    reader.at = standing.at
            elif (name := place_at(self.scene, reader)) and self.words[at] != "home":
                places.append(NameInOrder(name, at, reader.at, self.ruled_out(at)))
            at = max(reader.at, at + 1)
        return assets, places

    def _at_place(self, name: str) -> str:
        return self.scene.place_of(name) or "nowhere"

    def ruled_out(self, at: int) -> bool:
        """Return whether the words before token `at` exclude it: *not the hub*."""
        before = [w for w in self.words[max(at - 3, 0) : at] if w not in ("the", "to", "at")]
        return bool(before) and (before[-1] == "not" or before[-2:] in (["instead", "of"],))

    def has(self, *phrases: str) -> str:
        """Return the first of `phrases` that the order contains; '' if it contains none."""
        return next((phrase for phrase in phrases if f" {phrase} " in self.plain), "")

    @property
    def named_assets(self) -> list[str]:
        """The assets that the order names and does not exclude."""
        return [asset.name for asset in self.assets if not asset.ruled_out]

    @property
    def named_places(self) -> list[str]:
        """The places that the order names and does not exclude."""
        return [place.name for place in self.places if not place.ruled_out]

    @property
    def corrects(self) -> bool:
        """True if the order has a word of correction."""
        return bool(_CORRECTING & set(self.words)) or bool(self.has(*_CORRECTING_PHRASES))

    @property
    def short(self) -> bool:
        """True if the order is too short to be complete by itself."""
        return len([word for word in self.words if word[0].isalnum()]) <= _SHORT

    @property
    def does(self) -> bool:
        """True if the words ask for a task other than going to a place."""
        verbs = find_verbs(self.text.lower().replace("hold on", ""))
        return any(v.plain and v.tasks & _OWN_TASKS and not v.means & _PUTTING for v in verbs)

    @property
    def asks(self) -> bool:
        """True if the words ask for an action; in small talk, *it* is not an asset."""
        words = set(self.words)
        if self.places or words & (HOME | {"back"}) or ("?" in words and words & _WELL):
            return True
        if self.has(*THERE) and (self.named_assets or any(map(self.scene.members, words))):
            return True
        return any(verb.plain for verb in find_verbs(self.text))

    @property
    def there(self) -> str:
        """The destination of the last mission; '' if there are several."""
        return self.theres[0] if len(self.theres) == 1 else ""

    @property
    def theres(self) -> list[str]:
        """Every place that *there* may mean: the last destinations and the marked place."""
        marked = [self.scene.pointer] if self.scene.pointer in self.scene.world.frames else []
        return list(dict.fromkeys((*marked, *map(self.target, self.moves))))

    def target(self, move: Move) -> str:
        """Return the destination of `move`."""
        return self.scene.world.base if move.verb == "return_to_base" else move.target
