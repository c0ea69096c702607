"""Orders that demand and forbid the same thing, or send one asset to two places at once.

No plan can serve such an order, and what a model makes of it is chance. Corrections, sequences,
conditions and exclusions of other assets are no contradictions, and neither is what is not clear.
"""

from itertools import combinations
from typing import NamedTuple

from pa_console.language.demands import GOING, STAYING, Demand, demands_of
from pa_console.schema.world import World

_ONLY_GOING = frozenset((GOING,))


class Contradiction(NamedTuple):
    """Two parts of an order that exclude each other, in its own words, and the question back."""

    first: str
    second: str
    question: str


def contradiction(world: World, text: str) -> Contradiction | None:
    """Return the first two parts of an order that exclude each other, None if none do."""
    order = demands_of(world, text)
    clauses = [one for one in order.clauses if not (one.conditional or one.later)]
    for first, second in combinations(clauses, 2):
        excluded = (
            _forbidden(world, first, second)
            if first.negated != second.negated
            else not order.in_turn and _apart(first, second)
        )
        if excluded:
            asked = f"“{first.words}” and “{second.words}” exclude each other. What is to be done?"
            return Contradiction(first.words, second.words, asked)
    for one in clauses:
        if not order.in_turn and _is_split(one):
            here, there = one.goals
            asked = f"“{one.words}” sends {one.assets[0]} to {here} and {there} at once. Where to?"
            return Contradiction(here, there, asked)
    return None


def _forbidden(world: World, first: Demand, second: Demand) -> bool:
    """Return whether one of two demands forbids what the other demands."""
    ban, demand = (first, second) if first.negated else (second, first)
    if not ban.known or not _are_meant(world, ban, demand):
        return False
    acts = ban.acts - {GOING} or ban.acts
    if acts == _ONLY_GOING:
        moves = bool(demand.goals) and STAYING not in demand.acts
        if not ban.goals:
            return moves and GOING in demand.acts and bool(ban.assets or ban.kinds)
        return moves and not {*ban.goals}.isdisjoint(demand.goals)
    if STAYING in acts and not (ban.assets and (ban.put or ban.goals)):
        return False
    if not acts <= demand.acts:
        return False
    return not ban.goals or not {*ban.goals}.isdisjoint(demand.goals)


def _are_meant(world: World, ban: Demand, demand: Demand) -> bool:
    """Return whether a ban is about assets of a demand: named ones, their kind, or any at all."""
    if ban.assets:
        return not {*ban.assets}.isdisjoint(demand.assets)
    if ban.kinds:
        kinds = demand.kinds | {world.assets[name].kind for name in demand.assets}
        return bool(kinds) and kinds <= ban.kinds
    return True


def _apart(first: Demand, second: Demand) -> bool:
    """Return whether two demands want one asset at two places, or moved and left where it is.

    *Move it there and hold* is one after the other: only to stay where it is excludes moving.
    """
    if first.negated or {*first.assets}.isdisjoint(second.assets):
        return False
    if first.stays != second.stays:
        stay, move = (first, second) if first.stays else (second, first)
        return (
            GOING in move.acts and bool(move.goals) and stay.known and (stay.put or stay is first)
        )
    placed = first.known and second.known and len(first.goals) == len(second.goals) == 1
    return placed and first.goals != second.goals and "report" not in first.acts | second.acts


def _is_split(demand: Demand) -> bool:
    """Return whether a single asset is sent to two places."""
    alone = len(demand.assets) == 1 and len(demand.goals) == 2
    return alone and demand.split and not demand.negated and demand.acts == _ONLY_GOING
