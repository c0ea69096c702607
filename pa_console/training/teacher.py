"""The reference planner: an order and the situation in, plans to be verified and their aim out.

It never sees words. It proposes plans in the order of preference; who uses it verifies them and
takes the first that holds. What must be true of a run is written by teacher_success.py.
"""

from collections import deque
from collections.abc import Collection, Iterable, Iterator, Sequence

from pydantic import Field

from pa_console.orchestrator.premises import ENCOUNTERS
from pa_console.schema.base import Positive, StrictModel
from pa_console.schema.mission_set import Expectation
from pa_console.schema.plan import Plan, Verb
from pa_console.schema.telemetry import Digest, Picture
from pa_console.schema.world import World
from pa_console.training.conditions import due_asks
from pa_console.training.order import Ask, Order
from pa_console.training.teacher_draft import Draft
from pa_console.training.teacher_plan import Solution, plan_of
from pa_console.training.teacher_roster import Roster
from pa_console.training.teacher_solutions import MOST_PLANS, Barred, solved
from pa_console.training.teacher_success import conditions

WATCH_S, FOLLOW_S = 60.0, 150.0
"""So long a run is watched at least: for a plan, and for a workflow that goes on."""


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
    target = _chained(_targets(order, due_asks(order, picture), roster))
    if not verbs:
        return target
    fit = [
        p for p in (target.plan, *target.alternatives) if {a.verb for a in p.actions} <= {*verbs}
    ]
    if not fit:
        raise ValueError(f"no plan of {', '.join(verbs)} serves the order")
    update = {"plan": fit[0], "alternatives": tuple(fit[1:]), "otherwise": None}
    return target.model_copy(update=update)


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
    follow = _goes_on(plans[0], roster)
    return Target(
        plan=plans[0],
        expect=_expected(drafts),
        success=conditions([d.ask for d in drafts if d.done and d.commands], order, roster.world),
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
