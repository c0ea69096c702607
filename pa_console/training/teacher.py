"""The reference planner: an order and the situation in, plans to be verified and their aim out.

It never sees words. It proposes plans in the order of preference; who uses it verifies them and
takes the first that holds. What must be true of a run is written by teacher_success.py.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import islice

from pydantic import Field

from pa_console.orchestrator.premises import ENCOUNTERS
from pa_console.schema.base import Positive, StrictModel
from pa_console.schema.mission_set import Expectation
from pa_console.schema.plan import Plan, Verb
from pa_console.schema.telemetry import Digest, Picture
from pa_console.schema.world import World
from pa_console.training import teacher_encounters as encounters
from pa_console.training import teacher_moves as moves
from pa_console.training import teacher_still as still
from pa_console.training.conditions import due_asks
from pa_console.training.order import Ask, Order, Task
from pa_console.training.teacher_backfill import (
    bare_gates,
    fillings,
    relays,
    unseen_places,
)
from pa_console.training.teacher_draft import Desk, Draft, goals, refusal
from pa_console.training.teacher_objections import objection
from pa_console.training.teacher_plan import Solution, plan_of
from pa_console.training.teacher_roster import Roster
from pa_console.training.teacher_success import conditions

MOST_PLANS = 8
WATCH_S, FOLLOW_S = 60.0, 150.0
"""So long a run is watched at least: for a plan, and for a workflow that goes on."""
_TASKS: Mapping[Task, Callable[[Ask, Desk, Roster], list[Draft]]] = {
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
    "report": still.report,
    "hold": still.hold,
}


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


def teach(
    order: Order, world: World, picture: Picture, digest: Digest, verbs: Collection[Verb] = ()
) -> Target:
    """Return the target for `order`; only `verbs` are used when some are given.

    Raises ValueError when nothing can be done with these verbs.
    """
    roster = Roster(world, picture, digest)
    target = _target(order, due_asks(order, picture), roster, {})
    if not verbs:
        return target
    fit = [
        p for p in (target.plan, *target.alternatives) if {a.verb for a in p.actions} <= {*verbs}
    ]
    if not fit:
        raise ValueError(f"no plan of {', '.join(verbs)} serves the order")
    update = {"plan": fit[0], "alternatives": tuple(fit[1:]), "otherwise": None}
    return target.model_copy(update=update)


def _target(
    order: Order, asks: Sequence[Ask], roster: Roster, barred: Mapping[int, tuple[str, str]]
) -> Target:
    """Return the target when the asks with the `barred` places in order are refused."""
    first: Solution | None = None
    alike: list[Solution] = []
    needs: dict[int, tuple[str, str]] = {}
    for drafts in islice(_served(asks, Desk(reserved=_reserved(asks)), roster, barred), MOST_PLANS):
        culprits = _culprits(order, drafts, roster)
        found = list(islice(_filled(order, drafts, roster), MOST_PLANS))
        if not found and first is None and not needs:
            needs = culprits
        for solution in found:
            first = first or solution
            if _meaning(solution) == _meaning(first):
                alike.append(solution)
                needs = needs or culprits
    if first is None:
        if not needs.keys() - barred.keys():
            needs = dict.fromkeys(range(len(asks)), ("not together", "CAP-10"))
        return _target(order, asks, roster, {**barred, **needs})
    plans = [plan_of(order, solution, roster) for solution in alike]
    plans = list(dict.fromkeys(plans))[:MOST_PLANS]
    drafts = first.drafts
    follow = _goes_on(plans[0], roster)
    otherwise = None
    if needs and any(draft.done for draft in drafts):
        otherwise = _target(order, asks, roster, {**barred, **needs})
    return Target(
        plan=plans[0],
        expect=_expected(drafts),
        success=conditions([d.ask for d in drafts if d.done and d.commands], order, roster.world),
        watch_s=FOLLOW_S if follow else WATCH_S,
        rule_ids=tuple(dict.fromkeys(draft.rule for draft in drafts if draft.rule)),
        alternatives=tuple(plans[1:]),
        follow=follow,
        otherwise=otherwise,
    )


def _meaning(solution: Solution) -> list[tuple[Ask, bool]]:
    """Return what a solution serves of an order: equal for those that have the same aim."""
    return [(draft.ask, draft.done) for draft in solution.drafts]


def _served(
    asks: Sequence[Ask], desk: Desk, roster: Roster, barred: Mapping[int, tuple[str, str]]
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
    desk: Desk,
    roster: Roster,
    barred: Mapping[int, tuple[str, str]],
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
        for rest in _in_turn(asks[1:], Desk(used, desk.reserved), roster, barred):
            yield {number: option, **rest}


def _filled(order: Order, drafts: tuple[Draft, ...], roster: Roster) -> Iterator[Solution]:
    """Yield `drafts` with what they need besides; nothing when that may or can not be had."""
    reserved = _reserved([draft.ask for draft in drafts])
    if not _culprits(order, drafts, roster, alone=True):
        for filled in fillings(drafts, roster, reserved):
            yield Solution(drafts, filled)
        if not order.others_stay and not bare_gates(drafts, roster):
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
        if alone and not (order.others_stay or draft.ask.strict_who):
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


def _reserved(asks: Sequence[Ask]) -> frozenset[str]:
    """Return everybody whom the asks name."""
    return frozenset(name for ask in asks for name in (*ask.who.names, ask.leaving) if name)
