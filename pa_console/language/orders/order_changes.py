"""Reads orders about standing orders: *stop the west patrol*, *skip the next one*, *revoke S2*.

They are only read where an order in force is meant: by its id, by words of its text, or because it
is the only one. A text that moves an asset, *stop the drone at the west gate*, is none of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from pa_console.language.lexicon import word_lists
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.reader import Reader, read_tokens

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


class Changeable(Protocol):
    """What words can change: a standing order, or an order in steps that is under way."""

    @property
    def id(self) -> str:
        """Its id."""
        ...

    @property
    def text(self) -> str:
        """Its words, as it was given."""
        ...

    @property
    def words(self) -> str:
        """What it is, in words."""
        ...

    @property
    def order(self) -> str:
        """Its words, as it is read."""
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
    """A change to standing orders, or to one under way, by their ids."""

    change: Change
    orders: tuple[str, ...]

    @property
    def done(self) -> str:
        """The change in words, once it is made."""
        return _DONE[self.change]


def read_change(text: str, orders: Sequence[Changeable]) -> OrderChange | Unclear | None:
    """Return a change to one of the `orders`, a question about it, or None for no such."""
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
    fits = [order for order in orders if all(word in _said(order) for word in rest)]
    fits = [order for order in fits if _said(order) & set(about)] or fits
    if not fits and not set(about) & set(_WORDS["own_nouns"]):
        return None
    if len(fits) != 1:
        those = "; ".join(f"{each.id}: {each.text}" for each in fits or orders)
        return Unclear("", f"Which order is meant? {those}. Say its id: {change} {orders[0].id}")
    return OrderChange(change, (fits[0].id,))


def _said(order: Changeable) -> set[str]:
    """Return the words of an order, as it was given and as it is read."""
    tokens = read_tokens(f"{order.text} {order.words} {order.order}")
    return {token.word for token in tokens} | {token.word.removesuffix("s") for token in tokens}


def _without(words: list[str], tail: list[str]) -> list[str]:
    """Return `words` without a `tail` such as *then carry on as normal*."""
    for at in range(len(words) - len(tail) + 1):
        if words[at : at + len(tail)] == tail:
            return words[:at]
    return words
