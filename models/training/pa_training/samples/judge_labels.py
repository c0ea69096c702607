"""What the judge is to say of a plan: by the truth of its run, with the reason in short.

A plan is taken only when its run and its meaning agree: one that looks right and failed by
accident, or looks wrong and does what was asked all the same, teaches nothing.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from pa_console.language.canonical.order import Ask
from pa_console.language.canonical.reading import planned
from pa_console.llm.roles.grammar import FEEDBACK_CHARS, TEXT
from pa_console.schema.command import Verb
from pa_console.schema.finding import Finding
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.world import World
from pa_training.order_generator.orders import canonical_order, due_asks
from pa_training.proof.verify import Verified
from pa_training.samples.corrupted_plans import named_in
from pa_training.samples.planner_samples import Proven
from pa_training.situations.situations import Situation

STILL: frozenset[Verb] = frozenset(("hold", "report"))


@dataclass
class Difference:
    """What is right and not planned, what is planned and not right, and what is done by others.

    Pairs are of an action that is right and the one that stands in its place. `alike` are pairs
    that come to the same unless the order says who; `others` have an asset that is not meant,
    `places` and `steps` the right asset at another place or with another task.
    """

    missing: list[Action] = field(default_factory=list[Action])
    extra: list[Action] = field(default_factory=list[Action])
    alike: list[tuple[Action, Action]] = field(default_factory=list[tuple[Action, Action]])
    others: list[tuple[Action, Action]] = field(default_factory=list[tuple[Action, Action]])
    places: list[tuple[Action, Action]] = field(default_factory=list[tuple[Action, Action]])
    steps: list[tuple[Action, Action]] = field(default_factory=list[tuple[Action, Action]])

    @property
    def size(self) -> int:
        """How much differs that matters."""
        pairs = len(self.others) + len(self.places) + len(self.steps)
        return 2 * (len(self.missing) + len(self.extra)) + pairs


def difference(
    right: Sequence[Action], plan: Sequence[Action], named: Collection[str], world: World
) -> Difference:
    """Return how `plan` differs from the `right` actions; assets that are `named` are meant.

    Flying somewhere and watching there count as the same, as do all ways back to the base.
    """
    found = Difference()
    wanted, given = list(right), list(plan)

    def pair(into: list[tuple[Action, Action]] | None, tests: Collection[str]) -> None:
        for one in list(wanted):
            for other in given:
                if _agree(one, other, tests, world):
                    wanted.remove(one)
                    given.remove(other)
                    if into is not None:
                        into.append((one, other))
                    break

    pair(None, ("agent", "effect"))
    for one in list(wanted):
        for other in given:
            free = one.agent not in named and other.agent not in named
            if free and _agree(one, other, ("kind", "effect"), world):
                wanted.remove(one)
                given.remove(other)
                found.alike.append((one, other))
                break
    pair(found.others, ("effect",))
    pair(found.places, ("agent", "verb"))
    pair(found.places, ("kind", "verb"))
    pair(found.steps, ("agent", "place"))
    pair(found.steps, ("kind", "place"))
    found.missing, found.extra = wanted, given
    return found


def _agree(one: Action, other: Action, tests: Collection[str], world: World) -> bool:
    """Whether two actions agree in everything that `tests` name."""
    effect, effect2 = _effect(one, world), _effect(other, world)
    agreements = {
        "agent": one.agent == other.agent,
        "kind": world.assets[one.agent].kind == world.assets[other.agent].kind,
        "effect": effect == effect2,
        "verb": effect[0] == effect2[0] and effect[1] != "",
        "place": effect[1] == effect2[1] and effect[1] != "",
    }
    return all(agreements[test] for test in tests)


def _effect(action: Action, world: World) -> tuple[str, str]:
    """Return what an action comes to: a place where the asset will be, or a verb with its place."""
    match action.verb:
        case "return_to_base":
            return "at", world.base
        case "move_to" | "observe":
            return "at", action.target or ""
        case verb:
            return verb, action.target or ""


_READABLE = re.compile(f"{TEXT}{{1,{FEEDBACK_CHARS}}}")


class Label(NamedTuple):
    """A verdict with its feedback and the ids of the rules that are broken."""

    right: bool
    feedback: str
    violated: tuple[str, ...]


class Unclear(NamedTuple):
    """Why a plan has no label."""

    why: str


def label_plan(
    proven: Proven, situation: Situation, plan: Plan, verified: Verified
) -> Label | Unclear:
    """Return what the judge is to say of `plan`, whose run is `verified`."""
    examination = verified.checked.examination
    findings = [finding for finding in examination.findings if finding.broken]
    breaches = [breach.rule_id for breach in verified.score.broken]
    violated = tuple(dict.fromkeys((*(f.rule_id for f in findings), *breaches)))
    right = verified.score.strict and not examination.blocked
    if right:
        why = why_right(proven, situation, plan)
    elif examination.blocked and not _forbidden(proven, plan, violated):
        why = _blocked(
            [finding for finding in findings if finding.blocking], examination.rehearsal, situation
        )
    else:
        why = why_wrong(proven, situation, plan)
    if not why:
        return Unclear("looks wrong and is right" if right else "looks right and is wrong")
    text = feedback(proven, situation, plan, why)
    if not readable(text):
        return Unclear("too long")
    return Label(right, text, violated)


def _forbidden(proven: Proven, plan: Plan, violated: Collection[str]) -> bool:
    """Whether a plan breaks just the rule for which the order is to be refused."""
    return moves(plan) and not moves(proven.plan) and bool({*violated} & {*proven.target.rule_ids})


def readable(text: str) -> bool:
    """Whether a judge can write `text`: short enough, and nothing to escape."""
    return _READABLE.fullmatch(text) is not None


def feedback(proven: Proven, situation: Situation, plan: Plan, why: str) -> str:
    """Return the canonical feedback: what was asked, what is planned, and `why` that is right."""
    world = situation.world
    words = canonical_order(proven.order, world, situation.picture, situation.digest)
    by_name = any(name in words for name in named_in(proven.order))
    said = f"asked: {words}; planned: {planned(plan.actions, world, by_name=by_name)}; {why}"
    if len(said) > FEEDBACK_CHARS and by_name:
        said = f"asked: {words}; planned: {planned(plan.actions, world, by_name=False)}; {why}"
    return said


def _nearest(proven: Proven, situation: Situation, plan: Plan) -> Difference:
    """Return how `plan` differs from the right plan that is most like it."""
    named, target = named_in(proven.order), proven.target
    plans = [proven.plan, target.plan, *target.alternatives]
    found = (difference(p.actions, plan.actions, named, situation.world) for p in plans)
    return min(found, key=lambda each: each.size)


def why_right(proven: Proven, situation: Situation, plan: Plan) -> str:
    """Return why a plan with a right run is right, '' when it does not look right."""
    found = _nearest(proven, situation, plan)
    rules = f" ({', '.join(proven.target.rule_ids)})" if proven.target.rule_ids else ""
    if not moves(proven.plan):
        if moves(plan):
            return ""
        holds = all(action.verb == "hold" for action in plan.actions)
        if proven.target.expect == "refuse" and rules:
            return f"refused{rules}, it fits" if holds else ""
        return "it fits" if found.size == 0 or (holds and _nothing_due(proven)) else ""
    asks = due_asks(proven.order, situation.picture)
    places = {ask.place for ask in asks}
    free = all(ask.who.kind is None for ask in asks)
    replaced = all(
        one.agent not in named_in(proven.order)
        and (free or (one.target or situation.world.base) not in places)
        for one, _ in found.others
    )
    replaced = replaced and not (found.others and any(ask.task == "mass" for ask in asks))
    if found.missing or found.extra or found.places or found.steps or not replaced:
        return ""
    if any(_too_few(ask, proven.plan, plan, situation) for ask in asks):
        return ""
    return f"the rest is refused{rules}, it fits" if proven.target.expect == "trim" else "it fits"


def _too_few(ask: Ask, right: Plan, plan: Plan, situation: Situation) -> bool:
    """Whether fewer assets of the kind that is asked for go to the place than should."""
    assets = situation.world.assets
    counts = [
        sum(assets[a.agent].kind == ask.who.kind and a.target == ask.place for a in each.actions)
        for each in (right, plan)
    ]
    return ask.who.kind is not None and bool(ask.place) and counts[1] < counts[0]


def _nothing_due(proven: Proven) -> bool:
    """Whether the proven plan only stands for doing nothing."""
    return [action.verb for action in proven.plan.actions] == ["hold"] and not any(
        ask.task == "hold" and ask.who.names for ask in proven.order.asks
    )


def _blocked(findings: list[Finding], rehearsal: Rehearsal | None, situation: Situation) -> str:
    """Return the first thing that the safeguards have against a plan."""
    if rehearsal is not None:
        grace_s = situation.world.coverage_grace_s
        for gate, cover in rehearsal.timeline.gates.items():
            if cover.covered_before and not cover.covered_after:
                return f"{gate} is left uncovered (WF-03)"
            if cover.covered_before and cover.longest_gap_s > grace_s:
                return f"{gate} is uncovered too long (WF-03)"
        for name, fact in rehearsal.timeline.assets.items():
            if not fact.finished:
                return f"{name} does not finish"
    return f"{findings[0].rule_id} is broken" if findings else ""


def why_wrong(proven: Proven, situation: Situation, plan: Plan) -> str:
    """Return why a legal plan is wrong, '' when it looks right."""
    found = _nearest(proven, situation, plan)
    rules = ", ".join(proven.target.rule_ids)
    if found.size == 0:
        return ""
    if not moves(proven.plan) and moves(plan):
        return f"must be refused ({rules})" if rules else "nothing is to move"
    if moves(proven.plan) and not moves(plan):
        return "it must be done"
    if _other_case(proven, situation, plan):
        return "the other case"
    return _told_apart(proven, situation, found)


def _other_case(proven: Proven, situation: Situation, plan: Plan) -> bool:
    """Whether a plan does what the order asks for when its condition is otherwise."""
    order = proven.order
    if order.condition is None:
        return False
    due = due_asks(order, situation.picture)
    other = order.otherwise if due == order.asks else order.asks
    wanted = {(ask.task, ask.place, ask.who.names) for ask in other}
    if not other or any(ask.wrong for ask in other):
        return False
    places = {place for _, place, _ in wanted} - {ask.place for ask in due} - {""}
    names = {name for _, _, names in wanted for name in names}
    there = {action.target for action in plan.actions}
    return bool(places) and places <= there and names <= set(plan.agents)


def _told_apart(proven: Proven, situation: Situation, found: Difference) -> str:
    """Return in words how a plan differs from the right one: the one thing, or what is missing."""
    world, named = situation.world, named_in(proven.order)
    kinds = [found.missing, found.extra, found.places, found.others, found.steps]
    if sum(bool(kind) for kind in kinds) == 1:
        if found.places:
            one, other = found.places[0]
            gates = {one.target, other.target} <= set(world.gates)
            return "another gate" if gates else "another place"
        if found.others:
            one, other = found.others[0]
            same = world.assets[one.agent].kind == world.assets[other.agent].kind
            return "another asset" if same or one.agent in named else "another kind of asset"
        if found.steps:
            one, other = found.steps[0]
            return f"{_verb(other)} instead of {_verb(one)}"
    pairs = (*found.others, *found.places, *found.steps)
    lacking = [*found.missing, *(one for one, _ in pairs)]
    asked_for = {ask.place for ask in due_asks(proven.order, situation.picture)}
    lacking.sort(key=lambda each: each.agent not in named and each.target not in asked_for)
    shown = lacking or found.extra
    alike = [action for action in shown if action.command == shown[0].command]
    words = planned(alike, world, by_name=bool(named))
    return f"{words} missing" if lacking else f"{words} not asked for"


def moves(plan: Plan) -> bool:
    """Whether a plan does more than let assets hold and report."""
    return any(action.verb not in STILL for action in plan.actions)


def _verb(action: Action) -> str:
    return {"move_to": "go", "return_to_base": "home"}.get(action.verb, action.verb)
