"""The meaning of an order: its canonical words, and the tasks that they ask for in a situation."""

import re
from dataclasses import dataclass

from pa_console.language.canonical.clauses import ASKED, NOTHING
from pa_console.language.canonical.order import Reading
from pa_console.language.canonical.reading import parted, read_asked
from pa_console.language.clause_grammar import asked_now
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World

NOTHING_ASKED = "no order"
"""How a reading says that the words ask the team for nothing."""
NO_ORDERS = ("nothing", "not now", "question", "standing order")
"""The meanings, alone instead of clauses, of words for which no asset moves now."""
FORBID = "forbid "
"""The beginning of the meaning of a prohibition."""
_CONDITIONAL = re.compile(r"if [^:]+: (?P<then>[^:]+), else: (?P<otherwise>[^:]+)")
_BEYOND = re.compile(
    r"(undo|instead:|unclear:|at \d|in \d|every )|; then | for \d+ (min|h|s)\b| patrol "
)
"""Meanings that the clauses of a single plan cannot express."""


@dataclass(frozen=True)
class Order:
    """The tasks that one mission asks for at a moment."""

    asked: str
    """The beginning of a reading, with the state of its condition: "asked: 1 drone home"."""
    reading: Reading
    """The tasks that are due."""
    other_case: Reading | None = None
    """The tasks that would be due if the condition were otherwise, None without a condition."""

    @property
    def named(self) -> frozenset[str]:
        """Every asset that the order names, in either case."""
        readings = [self.reading, *([self.other_case] if self.other_case else [])]
        asks = (ask for reading in readings for ask in reading.asks)
        return frozenset(name for ask in asks for name in (*ask.who.names, ask.leaving) if name)


def order_of(meaning: str, world: World, digest: Digest) -> Order:
    """Return the order that `meaning` is in a situation.

    Raises ValueError for a condition that `digest` does not decide, LookupError for a meaning
    without any task.
    """
    asked = asked_as_seen(meaning, world, digest)
    reading = read_asked(asked)
    words, limits = parted(meaning.split("; "))
    if reading is None or not reading.readable or words == NOTHING:
        raise LookupError(meaning)
    case = _CONDITIONAL.fullmatch(words)
    if case is None:
        return Order(asked, reading)
    cases = (read_asked("; ".join((f"{ASKED}{clauses}", *limits))) for clauses in case.groups())
    return Order(asked, reading, next((one for one in cases if one and one != reading), None))


def orders_nothing(meaning: str) -> bool:
    """Return whether no asset moves now for this meaning."""
    return meaning in NO_ORDERS or meaning.startswith((FORBID, "unclear:"))


def meaning_now(meaning: str) -> str:
    """Return the meaning in the clauses that the planner reads; '' where they cannot express it.

    A question, a standing order and unclear words are answered before any planner reads them.
    """
    if meaning in {NOTHING, "not now"} or meaning.startswith(FORBID):
        return NOTHING
    if orders_nothing(meaning) or _BEYOND.search(meaning):
        return ""
    return meaning


def corrected(meaning: str) -> str:
    """Return the meaning of a correction without the sign that it is one."""
    return meaning.removeprefix("instead: ")


def asked_as_seen(meaning: str, world: World, digest: Digest) -> str:
    """Return `meaning` as a reading begins, with the state of its condition.

    Raises ValueError for a condition that `digest` does not decide.
    """
    words, limits = parted(meaning.split("; "))
    if words == NOTHING:
        return f"{ASKED}{NOTHING_ASKED}"
    if _CONDITIONAL.fullmatch(words) is None:
        return f"{ASKED}{meaning}"
    undecided = "; ".join((f"{ASKED}{words}; now: open", *limits))
    asked = asked_now(world, digest, undecided)
    if asked == undecided:
        raise ValueError(f"{words}: the picture does not decide the condition")
    return asked


def names_asset(text: str, name: str) -> bool:
    """Return whether `name` stands in `text` as a word of its own."""
    return re.search(rf"\b{re.escape(name)}\b", text) is not None
