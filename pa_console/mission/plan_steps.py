"""Steps 2 to 6 for an order in steps: each is planned in the picture that the ones before leave.

A step is read, planned and judged like an order of its own. Its plan is rehearsed, and the next
step sees what the rehearsal has ended with. The plans are joined into one, which is examined and
approved as a whole.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from pa_console.fleets.foreseen import ForeseenFleet
from pa_console.language.mention_check import MentionCheck
from pa_console.language.plain_words import plain_reading
from pa_console.language.references.resolution import Answers
from pa_console.mission.context import MissionContext, PastOrders, ordered_by
from pa_console.mission.examine import Examination
from pa_console.mission.judge import judge
from pa_console.mission.plan import (
    UNTOLD,
    Candidate,
    PlanForDecision,
    PlanningFailure,
    plan,
    safeguards,
)
from pa_console.mission.retrieve import retrieve
from pa_console.mission.understand import (
    NotUnderstood,
    RefusedMission,
    StandingOffer,
    Understood,
    understand,
)
from pa_console.policy.findings import STRUCTURE_ID
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding, Verdict
from pa_console.schema.mission import Mission
from pa_console.schema.plan import MAX_REASON, Action, Plan

MAX_FEEDBACK = 600

Planned = PlanForDecision | PlanningFailure | NotUnderstood | RefusedMission


async def plan_steps(
    context: MissionContext, task: Mission, steps: Sequence[str], answers: Answers
) -> Planned:
    """Return one plan for all `steps` of `task`; what is not clear about a step, names it.

    A step that is blocked is the last one that is planned: nothing could follow it.
    """
    planned: list[PlanForDecision] = []
    at = _StepContext(context)
    for number, words in enumerate(steps, start=1):
        named = f"step {number}, “{words}”"
        step = at.begin(words)
        read = await understand(step, answers)
        context.attempts = step.attempts
        match read:
            case RefusedMission(reason):
                return RefusedMission(f"{named}: {reason}")
            case NotUnderstood(question):
                return replace(read, question=f"{named}: {question}")
            case StandingOffer():
                return NotUnderstood(f"{named}: a step has no condition or time of its own.")
            case Understood(mission):
                step.mission = mission
        text = step.mission.text
        context.emit(ev.OrderStepRead(step=number, steps=len(steps), text=text))
        found = await plan(step, retrieve(step, step.mission))
        if isinstance(found, PlanningFailure):
            return replace(found, error=f"{named}: {found.error}")
        found = await judge(step, found)
        context.attempts = step.attempts
        planned.append(found)
        if not at.went(found.best.examination, step.mission):
            break
    return await _joined(context, task, planned, len(steps))


class _StepContext:
    """The situation in which each step is planned, as the rehearsals of those before leave it."""

    def __init__(self, context: MissionContext) -> None:
        self._context, self._services, self._monitor = context, context.services, context.monitor

    def begin(self, words: str) -> MissionContext:
        """Return the context for a step with these words."""
        text = {"text": words, "typed": ""}
        mission = self._context.mission.model_copy(update=text)
        return replace(
            self._context, services=self._services, mission=mission, monitor=self._monitor
        )

    def went(self, found: Examination, mission: Mission) -> bool:
        """Take in how a step goes; False where it is blocked, so that nothing follows it."""
        rehearsal, world = found.rehearsal, self._services.fleet.world
        if found.blocked or rehearsal is None:
            return False
        before, past = self._services.fleet.picture(), self._services.past
        past = PastOrders([*past.missions], past.pointer)
        spoken = mission.model_copy(update={"source": "operator"})
        past.remember(spoken, ordered_by(found.plan, before), undid=False, corrects=False)
        fleet = ForeseenFleet(world, rehearsal.after)
        self._services = replace(self._services, fleet=fleet, past=past)
        self._monitor = self._monitor.copy()
        for moment in rehearsal.moments:
            self._monitor.observe(moment)
        return True


async def _joined(
    context: MissionContext, task: Mission, planned: Sequence[PlanForDecision], count: int
) -> PlanForDecision:
    """Examine the plans of the steps as one, and return it with what was found of each."""
    bests = [each.best for each in planned]
    whole = joined_plan(bests)
    number = context.next_attempt()
    context.emit(ev.PlanProposed(attempt=number, author="console", text=whole.answer, plan=whole))
    found = await safeguards(context, task, whole)
    found = replace(found, findings=(*_unplanned(bests, count), *found.findings))
    if found.rehearsal is not None and context.services.variant.rehearsal:
        context.emit(
            ev.PlanRehearsed(attempt=number, rehearsal=found.rehearsal, seconds=found.rehearsal_s)
        )
    verdict, error = _verdict(bests)
    best = Candidate(
        number,
        found,
        unmet=tuple(
            f"step {step}: {text}"
            for step, each in enumerate(bests, start=1)
            for text in each.unmet
        ),
        narrowed=any(best.narrowed for best in bests),
        mentions=_mentions(bests),
        verdict=verdict,
        judge_error=error,
        by_server=any(UNTOLD in each.gaps_told for each in bests),
    )
    context.emit(
        ev.PlanChecked(
            attempt=number,
            findings=found.findings,
            seconds=found.checks_s,
            unmet=best.unmet,
            gaps=best.mentions.gaps,
        )
    )
    if context.services.variant.judging and not found.blocked:
        context.emit(ev.PlanJudged(attempt=number, verdict=verdict, error=error))
    last = planned[-1].answered
    answered = replace(last, retrieved=replace(last.retrieved, task=task, chosen=""))
    return PlanForDecision(answered, best, steps=tuple(planned))


def joined_plan(bests: Sequence[Candidate]) -> Plan:
    """Return the plans of the steps as one, in which each comes after the one before it."""
    actions: list[Action] = []
    told: list[str] = []
    before: tuple[int, ...] = ()
    for best in bests:
        first, each = len(actions) + 1, best.examination.plan
        actions += [action.model_copy(update={"after": before}) for action in each.actions]
        before = tuple(range(first, len(actions) + 1)) or before
        told.append(plain_reading(best.asked) if best.asked else each.reason)
    return Plan(reason="; then ".join(told)[:MAX_REASON], actions=tuple(actions))


def _unplanned(bests: Sequence[Candidate], count: int) -> Iterator[Finding]:
    """Yield a critical finding for a step that orders nothing, and for those never planned."""
    faults = [
        f"step {number} orders nothing"
        for number, best in enumerate(bests, start=1)
        if not best.examination.plan.actions
    ]
    if len(bests) < count:
        faults.append(f"step {len(bests)} of {count} is blocked, so none after it was planned")
    for fault in faults:
        yield Finding(rule_id=STRUCTURE_ID, priority="critical", status="violates", message=fault)


def _mentions(bests: Sequence[Candidate]) -> MentionCheck:
    """Return what the readings of the steps account for, as one; one baseless step is enough."""
    found = [best.mentions for best in bests]
    return MentionCheck(
        tuple(one for each in found for one in each.mentions),
        tuple(one for each in found for one in each.unsupported),
        any(each.moves for each in found),
        any(each.baseless for each in found),
        tuple(said for each in found for said in each.times),
    )


def _verdict(bests: Sequence[Candidate]) -> tuple[Verdict | None, str]:
    """Return the judge's verdicts on the steps as one: no objection takes all of them."""
    for number, best in enumerate(bests, start=1):
        if best.verdict is None:
            return None, f"step {number}: {best.judge_error or 'no verdict'}"
    verdicts = [best.verdict for best in bests if best.verdict is not None]
    objections = [
        f"step {number}: {verdict.feedback}"
        for number, verdict in enumerate(verdicts, start=1)
        if verdict.verdict == "Failure"
    ]
    rules = {opinion.rule_id: opinion for verdict in verdicts for opinion in verdict.rules}
    feedback = "; ".join(objections or [f"no objection to the {len(verdicts)} steps"])
    return (
        Verdict(
            verdict="Failure" if objections else "Success",
            rules=tuple(rules.values()),
            feedback=feedback[:MAX_FEEDBACK],
        ),
        "",
    )
