"""Words that take effect at once: changes to standing orders, and manual control of an asset.

*Stop the west patrol*, *skip the next one* and *revoke S2* are read as changes only if they
identify an order in force: by its id, by words of its text, or because it is the only one. *Take
over Drone_T04*, *I'll fly it myself* and *give it back* are read only if the whole text is about
manual control of an asset that is named, described or marked on the screen. A text that moves an
asset, such as *stop the drone at the west gate*, is neither.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, Protocol

from pa_console.language.lexicon import word_lists
from pa_console.language.name_linking import link_names
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.description import fitting
from pa_console.language.references.description_grammar import find_descriptions
from pa_console.language.references.reader import Reader, WordToken, read_tokens
from pa_console.language.references.scene import ReferenceScene

Change = Literal["revoke", "pause", "resume", "skip"]

_WORDS = word_lists("order_changes")
_VERBS: tuple[tuple[Change, tuple[str, ...]], ...] = (
    ("skip", _WORDS["skip"]),
    ("resume", _WORDS["resume"]),
    ("pause", _WORDS["pause"]),
    ("revoke", _WORDS["revoke"]),
)
_DONE: dict[Change, str] = {
    "revoke": "revoked", "pause": "paused", "resume": "resumed", "skip": "skipped once",
}  # fmt: skip
_NOUNS = frozenset(_WORDS["nouns"])
_NEXT = frozenset(_WORDS["next"])
_FILLERS = frozenset(_WORDS["fillers"])

_MANUAL = word_lists("manual_control")
_MANUAL_FILLERS = frozenset(_MANUAL["fillers"])
_JOINED = frozenset(_MANUAL["joined"])
_POINTED = frozenset(_MANUAL["pointed"])
_ALL = frozenset(_MANUAL["all"])
_ASSET_SLOT = "X"
MOST_WORDS = 24
"""The largest number of words in a text that is read as a request for manual control."""


class Changeable(Protocol):
    """An order that words can change: a standing order, or an order in steps that is under way."""

    @property
    def id(self) -> str:
        """The id of the order."""
        ...

    @property
    def text(self) -> str:
        """The order in the operator's words."""
        ...

    @property
    def words(self) -> str:
        """A description of the order."""
        ...

    @property
    def order(self) -> str:
        """The order as the console has read it."""
        ...


@dataclass(frozen=True)
class OrderUnderWay:
    """A patrol or another order in steps that a mission carries out; its id is the mission's."""

    id: str
    text: str
    words: str
    order: str


@dataclass(frozen=True)
class OrderChange:
    """A change to standing orders, or to an order under way; `orders` are their ids."""

    change: Change
    orders: tuple[str, ...]

    @property
    def done(self) -> str:
        """The word for the change after it is made: *revoked*."""
        return _DONE[self.change]


def read_change(text: str, orders: Sequence[Changeable]) -> OrderChange | Unclear | None:
    """Return a change to one of the `orders`, a question about it, or None for any other text."""
    if not orders:
        return None
    reader = Reader(read_tokens(text))
    reader.skip(_FILLERS)
    change: Change | None = next((name for name, words in _VERBS if reader.take(*words)), None)
    if change is None:
        return None
    words = [token.word for token in reader.tokens[reader.at :]]
    for tail in _WORDS["carry_on"]:
        words = _without(words, tail.split())
    ids = {order.id.lower(): order.id for order in orders}
    named = [ids[word] for word in words if word in ids]
    words = [word for word in words if word not in ids and word not in _FILLERS and word.isalnum()]
    about = [word for word in words if word in _NOUNS or (change == "skip" and word in _NEXT)]
    if named:
        return (
            OrderChange(change, tuple(dict.fromkeys(named))) if len(about) == len(words) else None
        )
    if not about:
        return None
    if "all" in words or "every" in words:
        rest = [word for word in words if word not in about and word not in ("all", "every")]
        return OrderChange(change, tuple(ids.values())) if not rest else None
    rest = [word for word in words if word not in _NOUNS and word not in _NEXT]
    fits = [order for order in orders if all(word in _words_of(order) for word in rest)]
    fits = [order for order in fits if _words_of(order) & set(about)] or fits
    if not fits and not set(about) & set(_WORDS["own_nouns"]):
        return None
    if len(fits) != 1:
        listed = "; ".join(f"{order.id}: {order.text}" for order in fits or orders)
        return Unclear("", f"Which order is meant? {listed}. Give its id: {change} {orders[0].id}")
    return OrderChange(change, (fits[0].id,))


def _words_of(order: Changeable) -> set[str]:
    """Return the words of an order, both the operator's and the console's."""
    tokens = read_tokens(f"{order.text} {order.words} {order.order}")
    return {token.word for token in tokens} | {token.word.removesuffix("s") for token in tokens}


def _without(words: list[str], tail: list[str]) -> list[str]:
    """Return `words` without a `tail` such as *then carry on as normal*."""
    for at in range(len(words) - len(tail) + 1):
        if words[at : at + len(tail)] == tail:
            return words[:at]
    return words


@dataclass(frozen=True)
class ManualWords:
    """The assets to take under manual control, or to give back if `take` is False."""

    take: bool
    assets: tuple[str, ...]


def read_manual(
    scene: ReferenceScene, text: str, taken: Collection[str]
) -> ManualWords | Unclear | None:
    """Return the request for manual control in `text`, a question about it, or None.

    The `taken` assets are under manual control at this station. *It* means the asset marked on the
    screen, or else the only taken asset.
    """
    linked = link_names(scene.world, text)
    tokens = [token for token in read_tokens(linked) if token.word not in _MANUAL_FILLERS]
    if not tokens or len(tokens) > MOST_WORDS:
        return None
    for name, take in (("take", True), ("give_back", False), ("give_back_taken", False)):
        if name == "give_back_taken" and not taken:
            return None
        for asset_tokens in _slots(name, tokens):
            assets = _assets(scene, linked, asset_tokens, () if take else taken)
            if isinstance(assets, Unclear):
                return assets
            if assets and (name != "give_back_taken" or {*assets} <= {*taken}):
                return ManualWords(take, assets)
    return None


def _slots(name: str, tokens: Sequence[WordToken]) -> Iterator[Sequence[WordToken]]:
    """Yield the tokens that stand for assets, for each phrase of the list `name` that matches."""
    words = "".join(f"{token.word} " for token in tokens)
    for pattern in _phrases(name):
        if match := pattern.fullmatch(words):
            first = words[: match.start("who")].count(" ")
            yield tokens[first : first + match["who"].count(" ") + 1]


@cache
def _phrases(name: str) -> tuple[re.Pattern[str], ...]:
    """Return the patterns of a list, in which `[word]` is optional and `one|other` a choice."""

    def part(word: str) -> str:
        if word == _ASSET_SLOT:
            return r"(?P<who>\S+(?: \S+)*?) "
        bare = word.strip("[]")
        either = "|".join(re.escape(way) for way in bare.split("|"))
        return f"(?:(?:{either}) )?" if word.startswith("[") else f"(?:{either}) "

    return tuple(re.compile("".join(map(part, way.split()))) for way in _MANUAL[name])


def _assets(
    scene: ReferenceScene, text: str, tokens: Sequence[WordToken], taken: Collection[str]
) -> tuple[str, ...] | Unclear:
    """Return the assets that the words `tokens` name, describe or point at."""
    words = [token.word for token in tokens]
    if " ".join(words) in _POINTED:
        pointed = [scene.pointer] if scene.pointer in scene.world.assets else [*taken]
        return tuple(pointed) if len(pointed) == 1 else ()
    if " ".join(words) in _ALL:
        return tuple(taken)
    names = [scene.assets_by_word.get(word, "") for word in words if word not in _JOINED]
    if names and all(names):
        return tuple(dict.fromkeys(names))
    phrase = text[tokens[0].start : tokens[-1].end]
    described = [*find_descriptions(scene, read_tokens(phrase), phrase)]
    if len(described) != 1 or described[0].sort != "asset":
        return ()
    description = replace(described[0], words=phrase)
    if (description.start, description.end) != (0, len(phrase)):
        return ()
    fit = fitting(scene, description)
    if len(fit) == 1:
        return fit
    many = f"{len(fit)} assets fit" if fit else "No asset fits"
    return Unclear(phrase, f"{many} “{phrase}”. Name it: take over Drone_T01", fit[:9])
