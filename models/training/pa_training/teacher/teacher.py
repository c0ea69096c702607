"""The reference planner: an order and the situation in, plans to be verified and their aim out.

A gate that loses its only guard gets another one in the same plan (WF-03); ground assets that go to
an unknown track get a drone that sees it before them (WF-02).

It never sees an operator's words. It proposes plans in the order of preference, which neither the
checks nor the rehearsal have seen; callers verify them and take the first that holds. What must be
true of a run is written by success.py.
"""

import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

from pydantic import Field

from pa_console.language.canonical.order import Ask, Task
from pa_console.llm.roles.grammar import REASON_CHARS
from pa_console.schema.base import Positive, StrictModel
from pa_console.schema.command import ENCOUNTERS
from pa_console.schema.evaluation import Expectation
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Digest, Picture
from pa_console.schema.world import KINDS, World
from pa_training.orders.meaning import Order
from pa_training.teacher import encounters, moves
from pa_training.teacher.moves import look
from pa_training.teacher.roster import (
    Command,
    Draft,
    Roster,
    TakenAssets,
    goals,
    going,
    objection,
    refusal,
)
from pa_training.teacher.success import conditions

MOST_FILLERS = 4
MOST_PLANS = 8
WATCH_S, FOLLOW_S = 60.0, 150.0
"""The least simulated time of a run: for a plan, and for a workflow that goes on."""
Barred = Mapping[int, tuple[str, str]]
"""The asks that are refused, by place in the order, each with why and under which rule."""
_STATE = re.compile(r"\w+: (free|alone|busy)(, \w+: (free|alone|busy))*")
"""Facts that are left out of a reason that tells of a takeover."""
_TASKS: Mapping[Task, Callable[[Ask, TakenAssets, Roster], list[Draft]]] = {
    "go": moves.go,
    "look": moves.look,
    "identify": encounters.identify,
    "warn": encounters.warn,
    "block": encounters.block,
    "respond": encounters.respond,
    "cover": moves.cover,
    "relieve": moves.relieve,
    "swap": moves.swap,
    "home": moves.home,
    "stand_down": moves.stand_down,
    "mass": moves.mass,
    "report": moves.report,
    "hold": moves.hold,
}


class Filled(NamedTuple):
    """Commands that are added to a plan, and why."""

    commands: tuple[Command, ...] = ()
    why: tuple[str, ...] = ()


def bare_gates(drafts: Sequence[Draft], roster: Roster) -> tuple[str, ...]:
    """Return the gates that the drafts leave without anybody."""
    return roster.bare(goals(_commands(drafts), roster.world))


def unseen_places(drafts: Sequence[Draft], roster: Roster) -> tuple[str, ...]:
    """Return the places to which only ground assets go although a track there is unseen."""
    ends = goals(_commands(drafts), roster.world)
    found: list[str] = []
    for name, place in ends.items():
        seen = any(roster.kind(other) == "uav" for other, at in ends.items() if at == place)
        committed = roster.kind(name) != "uav" and roster.picture.assets[name].post != place
        watched = any(n not in ends for n in roster.there(place, ("uav",)))
        if committed and not seen and not watched and roster.unseen(place):
            found.append(place)
    return tuple(dict.fromkeys(found))


def fillings(drafts: Sequence[Draft], roster: Roster, reserved: frozenset[str]) -> Iterator[Filled]:
    """Yield ways to keep every gate covered and every unknown track seen first, best first.

    Nothing is yielded when there is none.
    """
    ends = goals(_commands(drafts), roster.world)
    busy = frozenset(agent for draft in drafts for agent in draft.agents) | reserved
    yield from islice(_looks_first(drafts, ends, busy, roster), MOST_FILLERS * 2)


def relays(drafts: Sequence[Draft], roster: Roster, reserved: frozenset[str]) -> Iterator[Filled]:
    """Yield additional drones for gates whose next guard comes over the ground, and so too late."""
    ends = goals(_commands(drafts), roster.world)
    busy = frozenset(agent for draft in drafts for agent in draft.agents) | reserved
    for gate, cover in roster.picture.gates.items():
        left = cover.covered and all(ends.get(name, gate) != gate for name in cover.by)
        flown = any(at == gate and roster.kind(n) == "uav" for n, at in ends.items())
        if not left or flown:
            continue
        for drone in roster.free(("uav",), busy):
            if not roster.bare({**ends, drone: gate}):
                order = going(drone, gate, roster.world)
                yield Filled((order,), (f"{drone} fills the gap at {gate} (WF-03)",))


def _looks_first(
    drafts: Sequence[Draft], ends: Mapping[str, str], busy: frozenset[str], roster: Roster
) -> Iterator[Filled]:
    """Yield takeovers together with the looks from the air that are needed."""
    for taken_over in _takeovers(ends, busy, roster):
        used = busy | {agent for agent, _ in taken_over.commands}
        looks = Filled()
        for place in unseen_places(drafts, roster):
            drafted = look(Ask(task="look", place=place), TakenAssets(used=used), roster)
            drone = next((d.agents[0] for d in drafted if d.agents), "")
            if not drone:
                return
            used |= {drone}
            why = f"{drone} looks first (WF-02)"
            looks = Filled((*looks.commands, (drone, f"observe {place}")), (*looks.why, why))
        yield Filled((*taken_over.commands, *looks.commands), (*taken_over.why, *looks.why))


def _takeovers(ends: Mapping[str, str], busy: frozenset[str], roster: Roster) -> Iterator[Filled]:
    """Yield a guard for every gate that would be bare: free drones before other free assets."""
    bare = roster.bare(ends)
    if not bare:
        yield Filled()
        return
    gate = bare[0]
    leaver = next(n for n in roster.picture.gates[gate].by if ends.get(n, gate) != gate)
    alone = roster.alone_at(leaver) == gate
    left = f"{leaver}: alone at {gate} (WF-03)" if alone else f"nobody stays at {gate} (WF-03)"
    pool = [n for n in roster.free(KINDS, busy) if roster.stands(n) != gate]
    tried = 0
    for name in pool:
        after = {**ends, name: gate}
        if len(roster.bare(after)) >= len(bare):
            continue
        order = going(name, gate, roster.world)
        why = f"{left}, {roster.offered([name])} takes over"
        for rest in _takeovers(after, busy | {name}, roster):
            yield Filled((order, *rest.commands), (why, *rest.why))
        tried += 1
        if tried >= MOST_FILLERS:
            return


def _commands(drafts: Sequence[Draft]) -> list[Command]:
    return [command for draft in drafts for command in draft.commands]


class Solution(NamedTuple):
    """Drafts for every ask, and what is added to them."""

    drafts: tuple[Draft, ...]
    filled: Filled


def plan_of(order: Order, solution: Solution, roster: Roster) -> Plan:
    """Return the plan of a solution: takeovers first, then the asks in order; else one hold."""
    commands = [*solution.filled.commands, *(c for d in solution.drafts for c in d.commands)]
    why = [*solution.filled.why]
    for draft in solution.drafts:
        said = [w for w in draft.why if not (solution.filled.why and _STATE.fullmatch(w))]
        why += [f"{w} ({draft.rule})" if draft.rule and "(" not in w else w for w in said]
    if not commands:
        commands = _holder([draft.ask for draft in solution.drafts], roster)
        why += ["hold"] if any(d.ask.task != "hold" for d in solution.drafts) else []
    return Plan(
        reason=_reason(order, why),
        actions=tuple(Action(agent=agent, command=command) for agent, command in commands),
    )


def _reason(order: Order, why: Sequence[str]) -> str:
    """Return the canonical reason, no longer than a grammar lets it be."""
    words = order.asked
    parts = list(dict.fromkeys(why)) or ["nothing to do"]
    while len(parts) > 1 and len(words) + 2 + len(", ".join(parts)) > REASON_CHARS:
        parts.pop(-2 if parts[-1] == "hold" else -1)
    text = f"{words}; {', '.join(parts)}"
    return text if len(text) <= REASON_CHARS else text[: text.rfind(" ", 0, REASON_CHARS)]


def _holder(asks: Sequence[Ask], roster: Roster) -> list[Command]:
    """Return a hold by the first asset named that is up, else the first free one, else any."""
    named = [name for ask in asks for name in (*ask.who.names, ask.leaving) if roster.up(name)]
    names = [*named, *roster.free(("uav", "ugv", "robot")), *roster.every()]
    return [(name, "hold") for name in names[:1]]


def solved(
    order: Order, asks: Sequence[Ask], roster: Roster, barred: Barred
) -> tuple[list[Solution], Barred]:
    """Return solutions of one aim that refuse the `barred` asks, and which others need more."""
    first: Solution | None = None
    alike: list[Solution] = []
    needs: Barred = {}
    for drafts in islice(
        _served(asks, TakenAssets(reserved=_reserved(asks)), roster, barred), MOST_PLANS
    ):
        culprits = _culprits(order, drafts, roster)
        found = list(islice(_filled(order, drafts, roster), MOST_PLANS))
        if not found and first is None and not needs:
            needs = culprits
        for solution in found:
            first = first or solution
            if _meaning(solution) == _meaning(first):
                alike.append(solution)
                needs = needs or culprits
    return alike, needs


def _meaning(solution: Solution) -> list[tuple[Ask, bool]]:
    """Return what a solution serves of an order: equal for those that have the same aim."""
    return [(draft.ask, draft.done) for draft in solution.drafts]


def _served(
    asks: Sequence[Ask], desk: TakenAssets, roster: Roster, barred: Barred
) -> Iterator[tuple[Draft, ...]]:
    """Yield drafts for all asks, in their order; who serves one is taken for those after it.

    Those who report because nobody is named are whoever has nothing else to do.
    """
    turns = sorted(enumerate(asks), key=lambda turn: _waits(turn[1]))
    for drafts in _in_turn(turns, desk, roster, barred):
        yield tuple(drafts[number] for number in range(len(asks)))


def _waits(ask: Ask) -> bool:
    return ask.task == "report" and not ask.who.names


def _in_turn(
    asks: Sequence[tuple[int, Ask]],
    desk: TakenAssets,
    roster: Roster,
    barred: Barred,
) -> Iterator[dict[int, Draft]]:
    """Yield drafts for the numbered `asks`, by number: who serves one is taken for the next."""
    if not asks:
        yield {}
        return
    number, ask = asks[0]
    problem = barred.get(number) or objection(ask, roster)
    options = [refusal(ask, *problem)] if problem else _TASKS[ask.task](ask, desk, roster)
    for option in options:
        used = desk.used | {*option.agents}
        for rest in _in_turn(asks[1:], TakenAssets(used, desk.reserved), roster, barred):
            yield {number: option, **rest}


def _filled(order: Order, drafts: tuple[Draft, ...], roster: Roster) -> Iterator[Solution]:
    """Yield `drafts` with what they need besides; nothing when that may or can not be had."""
    reserved = _reserved([draft.ask for draft in drafts])
    if not _culprits(order, drafts, roster, alone=True):
        for filled in fillings(drafts, roster, reserved):
            yield Solution(drafts, filled)
        if not order.reading.others_stay and not bare_gates(drafts, roster):
            for filled in relays(drafts, roster, reserved):
                yield Solution(drafts, filled)


def _culprits(
    order: Order, drafts: Sequence[Draft], roster: Roster, *, alone: bool = False
) -> dict[int, tuple[str, str]]:
    """Return by place the asks that need somebody besides, with why they would be refused.

    With `alone`, only those of which the words say that nobody else may help.
    """
    found: dict[int, tuple[str, str]] = {}
    bare, unseen = set(bare_gates(drafts, roster)), set(unseen_places(drafts, roster))
    left = _left(goals([c for draft in drafts for c in draft.commands], roster.world), roster)
    for number, draft in enumerate(drafts):
        if alone and not order.reading.others_stay:
            continue
        ends = goals(draft.commands, roster.world)
        own = [(gate, name) for gate in left for name in left[gate] if ends.get(name, gate) != gate]
        own = [(gate, name) for gate, name in own if gate in bare or not alone]
        if own:
            gate, name = own[0]
            state = "alone" if len(left[gate]) == 1 else "needed"
            found[number] = f"{name} {state} at {gate}", "WF-03"
        elif unseen & {*ends.values()}:
            found[number] = "no drone looks first", "WF-02"
    return found


def _left(ends: Mapping[str, str], roster: Roster) -> dict[str, tuple[str, ...]]:
    """Return the gates of which every guard is sent elsewhere, each with its guards."""
    return {
        gate: cover.by
        for gate, cover in roster.picture.gates.items()
        if cover.covered and all(ends.get(name, gate) != gate for name in cover.by)
    }


def _reserved(asks: Sequence[Ask]) -> frozenset[str]:
    """Return everybody whom the asks name."""
    return frozenset(name for ask in asks for name in (*ask.who.names, ask.leaving) if name)


class Target(StrictModel):
    """What is right for an order: the plan, what else would be, and what must be true of a run."""

    plan: Plan
    expect: Expectation
    success: tuple[str, ...] = Field(description="CEL over `run`")
    watch_s: Positive = WATCH_S
    rule_ids: tuple[str, ...] = Field(default=(), description="rules that limit the order")
    alternatives: tuple[Plan, ...] = Field(default=(), description="tried next, best first")
    follow: bool = Field(default=False, description="later workflow phases belong to it")
    otherwise: "Target | None" = Field(
        default=None, description="right when none of the plans keeps the rules"
    )


def teach(order: Order, world: World, picture: Picture, digest: Digest) -> Target:
    """Return the target for `order`."""
    roster = Roster(world, picture, digest, order.reading.excluded)
    return _chained(_targets(order, order.reading.asks, roster))


def _chained(targets: Iterable[Target]) -> Target:
    """Return the first of `targets`, each with the next one as what is right otherwise."""
    *others, chained = targets
    for target in reversed(others):
        chained = target.model_copy(update={"otherwise": chained})
    return chained


def _targets(order: Order, asks: Sequence[Ask], roster: Roster) -> Iterator[Target]:
    """Yield targets that refuse as little of the order as they can: what was asked last first.

    An ask is refused only where it needs somebody besides, or where nothing serves all of them.
    """
    waiting, tried = deque[Barred]([{}]), set[frozenset[int]]()
    while waiting:
        barred = waiting.popleft()
        if frozenset(barred) in tried:
            continue
        tried.add(frozenset(barred))
        alike, needs = solved(order, asks, roster, barred)
        if alike:
            yield _target(order, alike, roster)
        elif not needs.keys() - barred.keys():
            needs = dict.fromkeys(range(len(asks)), ("not together", "CAP-10"))
        more = sorted(needs.keys() - barred.keys(), reverse=True)
        waiting += [{**barred, number: needs[number]} for number in more]


def _target(order: Order, alike: Sequence[Solution], roster: Roster) -> Target:
    """Return the target that solutions of one aim come to."""
    plans = [plan_of(order, solution, roster) for solution in alike]
    plans = list(dict.fromkeys(plans))[:MOST_PLANS]
    drafts = alike[0].drafts
    served = [draft.ask for draft in drafts if draft.done and draft.commands]
    follow = _goes_on(plans[0], roster)
    return Target(
        plan=plans[0],
        expect=_expected(drafts),
        success=conditions(served, roster.world, others_stay=order.reading.others_stay),
        watch_s=FOLLOW_S if follow else WATCH_S,
        rule_ids=tuple(dict.fromkeys(draft.rule for draft in drafts if draft.rule)),
        alternatives=tuple(plans[1:]),
        follow=follow,
    )


def _goes_on(plan: Plan, roster: Roster) -> bool:
    """Whether the plan deals with a track whose workflow the console then goes on with (WF-01)."""
    gates = {action.target for action in plan.actions if action.verb in ENCOUNTERS}
    return any(
        track.gate in gates and track.identity != "authorized" and track.status != "leaving"
        for track in roster.picture.tracks.values()
    )


def _expected(drafts: Sequence[Draft]) -> Expectation:
    """Return what is right: all, a part, or nothing but to hold."""
    if not any(draft.done and draft.commands for draft in drafts):
        hold = all(draft.done and draft.ask.task == "hold" for draft in drafts)
        return "execute" if hold else "refuse"
    return "trim" if any(draft.undone for draft in drafts) else "execute"
