"""Steps 3 to 6 for a patrol: legs from place to place, with relief before a battery gets low.

A grammar reads the order, so neither planner nor second reader is asked. The judge is asked about
the first leg to each place. The rules are checked for every leg, in the forecast at its start.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from pa_console.language.canonical.clauses import written
from pa_console.language.canonical.facts import is_free
from pa_console.language.canonical.order import Task
from pa_console.language.orders.patrols import Patrol, legs_of
from pa_console.mission.context import ForeseenContext, MissionContext
from pa_console.mission.judge import judge, verdict_on
from pa_console.mission.plan import PlanForDecision, take
from pa_console.mission.planning.propose import without_planner
from pa_console.mission.rehearse import rehearse_steps
from pa_console.mission.retrieve import RetrievedRules, retrieve
from pa_console.mission.understand import NotUnderstood
from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.events import event as ev
from pa_console.schema.plan import MAX_REASON, Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.world import AssetKind

PREFERRED: tuple[AssetKind, ...] = ("uav", "robot", "ugv")
"""The kinds of assets in order of preference, for an order that names no asset or kind. The first
kind with a free asset is used."""
MOST_RELIEFS = 4
RESERVE_PCT = 2.0
"""The charge above the low mark that an asset must keep after its last leg, in percent."""


@dataclass(frozen=True)
class _Leg:
    """One place of a patrol and its asset; when it arrives, the asset that it `relieves` leaves."""

    place: str
    agent: str
    relieves: str = ""


async def plan_patrol(
    context: MissionContext, retrieved: RetrievedRules, patrol: Patrol, done: int = 0
) -> PlanForDecision | NotUnderstood:
    """Return the plan for a patrol without its first `done` legs, or a question."""
    agent = _first_agent(context, patrol)
    if not agent:
        needed = patrol.asset or (f"{patrol.kind}" if patrol.kind else "asset")
        return NotUnderstood(f"no {needed} is free for a patrol. Who is to go?")
    places = legs_of(patrol, context.services.scene, agent)[done:]
    legs = await _with_relief(context, patrol, agent, places)
    if isinstance(legs, NotUnderstood):
        return legs
    whole = _plan(context, patrol, legs)
    judged = await _judged(context, patrol, legs)
    answered = without_planner(context, retrieved)
    made = await take(context, answered, whole, author="console")
    verdict, error = verdict_on([step.best for step in judged])
    best = replace(made.best, verdict=verdict, judge_error=error)
    if context.services.variant.judging and not best.examination.blocked:
        context.emit(ev.PlanJudged(attempt=best.attempt, verdict=verdict, error=error))
    return PlanForDecision(answered, best, by_grammar=True)


def _first_agent(context: MissionContext, patrol: Patrol) -> str:
    """Return the asset of the first leg: the named asset, or the nearest free one; '' if none."""
    if patrol.asset:
        return patrol.asset
    scene = context.services.scene
    for kind in (patrol.kind,) if patrol.kind else PREFERRED:
        free = [n for n, a in scene.picture.assets.items() if a.kind == kind and scene.is_free(n)]
        if free:
            return min(free, key=lambda name: (scene.distance_m(name, patrol.places[0]), name))
    return ""


async def _with_relief(
    context: MissionContext, patrol: Patrol, agent: str, places: Sequence[str]
) -> list[_Leg] | NotUnderstood:
    """Return the legs; another asset takes over before each leg for which a battery is too low."""
    legs = [_Leg(place, agent) for place in places]
    world = context.services.fleet.world
    for _ in range(MOST_RELIEFS + 1):
        plan = _plan(context, patrol, legs)
        run = await rehearse_steps(context.services.fleet, plan)
        short = _first_short(plan, run.steps, world.low_battery_pct + RESERVE_PCT)
        if short is None:
            return legs
        number, spent = next((n, leg) for n, leg in enumerate(legs) if n >= short)
        other = _reliever(context, legs, number)
        if number == 0 or not other:
            place = legs[number].place
            why = f"the battery of {spent.agent} will not do for the leg to {place}"
            return NotUnderstood(f"{why}, and nobody is free to relieve it. Who is to go?")
        legs[number:] = [_Leg(leg.place, other) for leg in legs[number:]]
        legs[number] = replace(legs[number], relieves=spent.agent)
    return NotUnderstood(f"the patrol needs more than {MOST_RELIEFS} reliefs: give fewer laps.")


def _first_short(plan: Plan, steps: Sequence[Rehearsal], least_pct: float) -> int | None:
    """Return the first leg, from 0, after which an asset has too little charge to go home."""
    legs = -1
    for numbers, step in zip(plan.steps, steps, strict=False):
        going = [plan.actions[n - 1] for n in numbers if plan.actions[n - 1].target is not None]
        legs += bool(going)
        for action in going:
            began = step.before.assets[action.agent].battery_pct
            ended = step.timeline.assets[action.agent].least_battery_pct
            # The way home is assumed to need no more charge than this leg.
            if ended - (began - ended) < least_pct:
                return legs
    return None


def _reliever(context: MissionContext, legs: Sequence[_Leg], number: int) -> str:
    """Return the nearest free asset of the same kind that has no leg; '' if there is none."""
    scene, place = context.services.scene, legs[number].place
    kind = scene.asset(legs[number].agent).kind
    taken = {leg.agent for leg in legs}
    free = [
        name
        for name, asset in scene.picture.assets.items()
        if asset.kind == kind and name not in taken and is_free(asset, scene.sole)
    ]
    return min(free, key=lambda name: (scene.distance_m(name, place), name), default="")


def _plan(context: MissionContext, patrol: Patrol, legs: Sequence[_Leg]) -> Plan:
    """Return the plan of all legs, one after another."""
    actions: list[Action] = []
    before: tuple[int, ...] = ()
    for leg in legs:
        command = f"{_verb(context, leg.agent)} {leg.place}"
        actions.append(Action(agent=leg.agent, command=command, after=before, stay_s=patrol.stay_s))
        before = (len(actions),)
        if leg.relieves:
            home = Action(agent=leg.relieves, command="return_to_base", after=before)
            actions.append(home)
    return Plan(reason=patrol.words, actions=tuple(actions))


def _verb(context: MissionContext, agent: str) -> Verb:
    kind = context.services.fleet.world.assets[agent].kind
    return "observe" if kind in COMMANDS["observe"].kinds else "move_to"


async def _judged(
    context: MissionContext, patrol: Patrol, legs: Sequence[_Leg]
) -> list[PlanForDecision]:
    """Return a judged plan for the first leg to each place."""
    at, judged = ForeseenContext(context), list[PlanForDecision]()
    for leg in _first_legs(legs):
        verb = _verb(context, leg.agent)
        task: Task = "look" if verb == "observe" else "go"
        reading = "asked: " + written(task, {"who": leg.agent, "place": leg.place})
        step = at.begin(f"Send {leg.agent} to {leg.place}.")
        plan = Plan(
            reason=f"{reading}; {patrol.words}"[:MAX_REASON],
            actions=(Action(agent=leg.agent, command=f"{verb} {leg.place}"),),
        )
        answered = without_planner(step, retrieve(step, step.mission, chosen=reading))
        leg_plan = await judge(step, await take(step, answered, plan, author="console"))
        at.end(step)
        judged.append(leg_plan)
        if not at.went(leg_plan.best.examination, step.mission):
            break
    return judged


def _first_legs(legs: Sequence[_Leg]) -> Iterator[_Leg]:
    seen = set[str]()
    for leg in legs:
        if leg.place not in seen:
            seen.add(leg.place)
            yield leg
