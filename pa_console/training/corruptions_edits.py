"""Changes of a plan, action by action: some leave it right, some make it wrong, some illegal."""

import random
from collections.abc import Collection, Iterator, Sequence

from pa_console.orchestrator.digest import KINDS
from pa_console.schema.plan import COMMANDS, Action, Plan, Verb
from pa_console.schema.world import World
from pa_console.training.teacher_roster import Roster

Edit = tuple[str, tuple[Action, ...]]
"""In a word what was changed, and the actions then."""
_STILL: frozenset[Verb] = frozenset(("hold", "report"))


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
