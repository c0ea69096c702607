"""Other plans for a mission whose right plan is known: equally good ones, wrong ones, illegal ones.

They are only proposed here; whether a plan is right is found out by carrying it out.
"""

import random
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, NamedTuple

from pa_console.schema.plan import Action, Plan
from pa_console.training.conditions import due_asks
from pa_console.training.corruptions_edits import harmless_edits, unsafe_edits, wrong_edits
from pa_console.training.corruptions_orders import misread
from pa_console.training.order import Order
from pa_console.training.planner_data import Proven
from pa_console.training.situations import Situation
from pa_console.training.teacher import teach
from pa_console.training.teacher_roster import Roster

REASON = "another plan"
EASY = frozenset((
    "misread extra", "misread place", "edit place", "edit acts", "edit idle", "other mission",
))  # fmt: skip
"""Ways to be wrong that fit nearly every mission."""
SUBTLE = 3.0
"""The larger, the earlier the other ways come."""
Hope = Literal["right", "wrong", "unsafe"]
"""What a proposed plan is expected to be."""


class Variant(NamedTuple):
    """A plan and how it came about, e.g. `misread place`."""

    plan: Plan
    hope: Hope
    how: str


def named_in(order: Order) -> frozenset[str]:
    """Return every asset that the order names."""
    asks = (*order.asks, *order.otherwise)
    return frozenset(name for ask in asks for name in (*ask.who.names, ask.leaving) if name)


def right_variants(proven: Proven, situation: Situation, rng: random.Random) -> list[Variant]:
    """Return plans that should be as right as the proven one, in random order."""
    roster = Roster(situation.world, situation.picture, situation.digest)
    edits = list(harmless_edits(proven.plan, named_in(proven.order), roster, rng))
    plans = [(how, _plan(actions)) for how, actions in edits]
    plans += [("alternative", plan) for plan in proven.target.alternatives]
    found = [Variant(plan, "right", f"same {how}") for how, plan in plans]
    rng.shuffle(found)
    return _distinct(found, proven.plan)


def wrong_variants(
    proven: Proven, others: Sequence[Proven], situation: Situation, rng: random.Random
) -> list[Variant]:
    """Return plans that should be wrong, legal or not; each way to be wrong comes up early.

    `others` are missions in the same situation: their plans are right, but for them.
    """
    roster = Roster(situation.world, situation.picture, situation.digest)
    pools: dict[str, list[Variant]] = {}
    for variant in _wrong(proven, others, situation, roster, rng):
        pools.setdefault(variant.how, []).append(variant)
    for pool in pools.values():
        rng.shuffle(pool)
    found: list[Variant] = []
    while pools:
        for how in sorted(pools, key=lambda how: _rank(how, rng)):
            found.append(pools[how].pop())
            if not pools[how]:
                del pools[how]
    return _distinct(found, proven.plan)


def unsafe_variants(proven: Proven, situation: Situation, rng: random.Random) -> list[Variant]:
    """Return plans that should break a rule or not come to their end, in random order."""
    roster = Roster(situation.world, situation.picture, situation.digest)
    edits = list(unsafe_edits(proven.plan, roster, rng))
    rng.shuffle(edits)
    found = [Variant(_plan(actions), "unsafe", how) for how, actions in edits]
    return _distinct(found, proven.plan)


def _rank(how: str, rng: random.Random) -> float:
    """Return a number by which ways to be wrong are put in order: what is hard to see first."""
    return rng.random() ** (1.0 if how in EASY else SUBTLE)


def _wrong(
    proven: Proven,
    others: Sequence[Proven],
    situation: Situation,
    roster: Roster,
    rng: random.Random,
) -> Iterator[Variant]:
    world, picture, digest = situation.world, situation.picture, situation.digest
    for how, order in misread(proven.order, world, picture, rng):
        plan = teach(order, world, picture, digest).plan
        yield Variant(plan, "wrong", f"misread {how}")
    for how, actions in wrong_edits(proven.plan, roster, rng):
        yield Variant(_plan(actions), "wrong", f"edit {how}")
    for other in others:
        if other is not proven:
            yield Variant(other.plan, "wrong", "other mission")
    if proven.order.injected:
        for actions in _obeyed(proven, roster, rng):
            yield Variant(_plan(actions), "wrong", "injected")


def _obeyed(proven: Proven, roster: Roster, rng: random.Random) -> Iterator[tuple[Action, ...]]:
    """Yield plans that do what foreign text in the mission asks for, as far as names tell."""
    world, text = roster.world, proven.case.command
    meant = {
        word
        for ask in due_asks(proven.order, roster.picture)
        for word in (*ask.who.names, ask.place, ask.leaving)
    }
    places = [name for name in _mentioned(text, world.frames) if name not in meant]
    agents = [n for n in _mentioned(text, world.assets) if n not in meant and roster.up(n)]
    free = [name for name in roster.free(("uav", "ugv", "robot")) if name not in agents]
    for place in places or list(world.gates):
        for name in agents or free[:1]:
            command = "return_to_base" if place == world.base else f"move_to {place}"
            action = Action(agent=name, command=command)
            kept = [a for a in proven.plan.actions if a.agent != name and a.verb != "hold"]
            yield (action,) if rng.random() < 0.5 else (*kept, action)


def _mentioned(text: str, names: Iterable[str]) -> list[str]:
    """Return the `names` that stand in `text`, however they are spaced or written."""
    flat = re.sub(r"[^a-z0-9]", "", text.lower())
    return [name for name in names if re.sub(r"[^a-z0-9]", "", name.lower()) in flat]


def _plan(actions: Sequence[Action]) -> Plan:
    return Plan(reason=REASON, actions=tuple(actions))


def _distinct(variants: Sequence[Variant], plan: Plan) -> list[Variant]:
    """Return those that differ from `plan` and from one another in more than their reasons."""
    seen = {plan.actions}
    kept: list[Variant] = []
    for variant in variants:
        if variant.plan.actions and variant.plan.actions not in seen:
            seen.add(variant.plan.actions)
            kept.append(variant)
    return kept
