"""Other plans for a mission whose right plan is known: as good ones, wrong ones, illegal ones.

They are only proposed here; whether a plan is right is found out by carrying it out.
"""

import random
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import KINDS, World
from pa_training.samples.groups import Proven
from pa_training.situations.situations import Situation
from pa_training.teacher.roster import Roster
from pa_training.teacher.teacher import teach

Edit = tuple[str, tuple[Action, ...]]
"""In a word what was changed, and the actions then."""
_STILL: frozenset[Verb] = frozenset(("hold", "report"))
REASON = "another plan"
EASY = frozenset(("edit place", "edit acts", "edit idle", "other mission"))
"""Ways to be wrong that fit nearly every mission."""
SUBTLE = 3.0
"""The larger, the earlier the other ways come."""
Hope = Literal["right", "wrong", "unsafe"]
"""What a proposed plan is expected to be."""


def harmless_edits(
    plan: Plan, named: Collection[str], roster: Roster, rng: random.Random
) -> Iterator[Edit]:
    """Yield changes that should not matter: another free asset, another order, flying or looking.

    Assets that are `named` in the order stay.
    """
    actions, world = plan.actions, roster.world
    if len(actions) > 1:
        turned = list(actions)
        rng.shuffle(turned)
        yield "order", tuple(turned)
    for number, action in enumerate(actions):
        if action.agent not in named:
            for name in _idle(roster, actions, world.assets[action.agent].kind)[:2]:
                yield "asset", _put(actions, number, name, action.command)
        for command in _alike(action, world):
            yield "verb", _put(actions, number, action.agent, command)


def wrong_edits(plan: Plan, roster: Roster, rng: random.Random) -> Iterator[Edit]:
    """Yield changes that mostly matter and are mostly legal."""
    actions, world = plan.actions, roster.world
    for number, action in enumerate(actions):
        if len(actions) > 1:
            yield "dropped", (*actions[:number], *actions[number + 1 :])
        if action.target is not None:
            places = [g for g in world.gates if g != action.target] or list(world.frames)
            place = rng.choice(places)
            yield "place", _put(actions, number, action.agent, f"{action.verb} {place}")
            for name, command in _by_another_kind(action, actions, roster, rng):
                yield "kind", _put(actions, number, name, command)
            yield from _other_step(actions, number, world)
        alike = _idle(roster, actions, world.assets[action.agent].kind)
        if alike:
            yield "asset", _put(actions, number, rng.choice(alike), action.command)
    free = _idle(roster, actions)
    if free and any(action.verb not in _STILL for action in actions):
        name = rng.choice(free)
        here = [a.target for a in actions if a.target is not None]
        place = rng.choice(here if here and rng.random() < 0.4 else list(world.gates))
        yield "one more", (*actions, Action(agent=name, command=f"move_to {place}"))
    if all(action.verb in _STILL for action in actions) and free:
        gate = rng.choice(world.gates)
        yield "acts", (Action(agent=rng.choice(free), command=f"move_to {gate}"),)
    else:
        holder = rng.choice([*plan.agents, *free[:1]])
        yield "idle", (Action(agent=holder, command="hold"),)


def unsafe_edits(plan: Plan, roster: Roster, rng: random.Random) -> Iterator[Edit]:
    """Yield changes that break a rule or cannot be finished, mostly so that the checks see it."""
    actions, world = plan.actions, roster.world
    used = set(plan.agents)
    guards = [name for name in roster.digest.sole_cover.values() if name not in used]
    low = [name for name in roster.digest.low_battery if name not in used]
    tracks = [track.gate for track in roster.picture.tracks.values()]
    for number, action in enumerate(actions):
        if action.target is None:
            continue
        for name in (*guards, *low):
            if action.verb in _verbs(name, world):
                yield "guard leaves", _put(actions, number, name, action.command)
    if guards:
        gate = rng.choice(world.gates)
        yield (
            "guard leaves",
            (*actions, Action(agent=rng.choice(guards), command=f"move_to {gate}")),
        )
    if tracks:
        gate = rng.choice(tracks)
        for verb in ("identify", "warn", "block"):
            able = [n for n in _idle(roster, actions) if verb in _verbs(n, world)]
            if able:
                yield "escalates", (Action(agent=rng.choice(able), command=f"{verb} {gate}"),)


def _other_step(actions: Sequence[Action], number: int, world: World) -> Iterator[Edit]:
    """Yield an action of the same asset at the same place that does something else."""
    action = actions[number]
    for verb in _verbs(action.agent, world):
        if verb != action.verb and COMMANDS[verb].takes_frame:
            if {verb, action.verb} == {"move_to", "observe"}:
                continue
            yield "step", _put(actions, number, action.agent, f"{verb} {action.target}")


def _by_another_kind(
    action: Action, actions: Sequence[Action], roster: Roster, rng: random.Random
) -> Iterator[tuple[str, str]]:
    """Yield an asset of each other kind that could go there instead."""
    for kind in KINDS:
        free = _idle(roster, actions, kind)
        if kind != roster.kind(action.agent) and free:
            verb = action.verb if action.verb in _verbs(free[0], roster.world) else "move_to"
            yield rng.choice(free), f"{verb} {action.target}"


def _idle(roster: Roster, actions: Sequence[Action], kind: str = "") -> list[str]:
    """Return the free assets that the plan leaves out, of `kind` if given."""
    used = {action.agent for action in actions}
    return [n for n in roster.free(KINDS, used) if kind in ("", roster.kind(n))]


def _alike(action: Action, world: World) -> Iterator[str]:
    """Yield the command that comes to the same for a drone: flying there, or watching there."""
    if world.assets[action.agent].kind == "uav" and action.target is not None:
        if action.verb == "observe":
            yield f"move_to {action.target}"
        elif action.verb == "move_to":
            yield f"observe {action.target}"


def _verbs(name: str, world: World) -> list[Verb]:
    return [verb for verb, spec in COMMANDS.items() if world.assets[name].kind in spec.kinds]


def _put(actions: Sequence[Action], number: int, agent: str, command: str) -> tuple[Action, ...]:
    """Return `actions` with another one in place of the one at `number`."""
    return (*actions[:number], Action(agent=agent, command=command), *actions[number + 1 :])


class Variant(NamedTuple):
    """A plan and how it came about, e.g. `misread place`."""

    plan: Plan
    hope: Hope
    how: str


def right_variants(proven: Proven, situation: Situation, rng: random.Random) -> list[Variant]:
    """Return plans that should be as right as the proven one, in random order."""
    roster = Roster(situation.world, situation.picture, situation.digest)
    edits = list(harmless_edits(proven.plan, proven.order.named, roster, rng))
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
    other_case = proven.order.other_case
    if other_case is not None:
        order = replace(proven.order, reading=other_case)
        yield Variant(teach(order, world, picture, digest).plan, "wrong", "other case")
    for how, actions in wrong_edits(proven.plan, roster, rng):
        yield Variant(_plan(actions), "wrong", f"edit {how}")
    for other in others:
        if other is not proven:
            yield Variant(other.plan, "wrong", "other mission")


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
