"""Who can be thought of for what serves an order: those whom it names have their own commands."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from pa_console.llm.reading import Wish
from pa_console.llm.slot_grammar import Slot
from pa_console.orchestrator.hindrance import unfit
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.schema.world import AssetKind


class UntoldError(Exception):
    """What serves a wish depends on more than the picture tells."""


class Unit(NamedTuple):
    """Commands that serve a part of an order, all of them or none."""

    slots: tuple[Slot, ...]
    ahead: bool = False
    """Only to look where nobody is known to be: given up before anything else is."""


@dataclass(frozen=True)
class Stands(PlanMoves):
    """Where everybody stands before a plan that serves an order which names those `named`."""

    named: frozenset[str] = frozenset()

    def free(self, kind: AssetKind | None = None) -> list[str]:
        """Return who could be sent somewhere, of one kind if that is given, but for those named."""
        return [name for name in super().free(kind) if name not in self.named]

    def near(self, place: str, kind: AssetKind) -> tuple[str, ...]:
        """Return who of a kind stands at a place, then who is free; nobody who is named."""
        there = (name for name in self.there(place, kind) if name not in self.named)
        return tuple(dict.fromkeys((*there, *self.free(kind))))

    def fit(self, wish: Wish) -> list[str]:
        """Return those whom `wish` names and who can do their part of it."""
        return [n for n in wish.team.names if not unfit(n, wish, self.world, self.before)]


def each(slots: Iterable[Slot]) -> Iterator[Unit]:
    """Yield every slot as a unit of its own."""
    yield from (Unit((slot,)) for slot in slots)


def together(slots: Iterable[Slot]) -> Iterator[Unit]:
    """Yield one unit of all slots, if there are any."""
    if every := tuple(slots):
        yield Unit(every)
