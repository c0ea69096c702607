"""Steps 3 to 6 for an order in steps, each planned in the forecast after the step before it.

A step is read, planned and judged like an order of its own. Its plan is rehearsed, and the next
step begins at the end of the rehearsal. The plans are joined into one plan, which is examined and
approved as a whole.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from pa_console.language.canonical.reading import plain_reading
from pa_console.language.mention_check import MentionCheck
from pa_console.language.references.resolution import Answers
from pa_console.mission.context import ForeseenContext, MissionContext
from pa_console.mission.decide import unsettled
from pa_console.mission.judge import judge, verdict_on
from pa_console.mission.plan import (
    UNTOLD,
    Candidate,
    PlanForDecision,
    PlanningFailure,
    plan,
    safeguards,
)
from pa_console.mission.retrieve import retrieve
from pa_console.mission.sequences.plan_patrol import plan_patrol
from pa_console.mission.understand import (
    NotUnderstood,
    RefusedMission,
    StandingOffer,
    Understood,
    understand,
)
from pa_console.policy.findings import STRUCTURE_ID
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import MAX_REASON, Action, Plan

Planned = PlanForDecision | PlanningFailure | NotUnderstood | RefusedMission


async def plan_steps(
    context: MissionContext, task: Mission, steps: Sequence[str], answers: Answers
) -> Planned:
    """Return one plan for all `steps` of `task`; a question or a fault names its step.

    If a step is blocked, no later step is planned.
    """
    planned: list[PlanForDecision] = []
    at = ForeseenContext(context)
    for number, words in enumerate(steps, start=1):
        named = f"step {number}, “{words}”"
        step = at.begin(words)
        read = await understand(step, answers)
        at.end(step)
        match read:
            case RefusedMission(reason):
                return RefusedMission(f"{named}: {reason}")
            case NotUnderstood(question):
                return replace(read, question=f"{named}: {question}")
            case StandingOffer():
                return NotUnderstood(f"{named}: a step has no condition or time of its own.")
            case Understood():
                step.mission, step.described = read.mission, read.described
        text = step.mission.text
        context.emit(ev.OrderStepRead(step=number, steps=len(steps), text=text))
        step_plan = await _planned(step, read)
        at.end(step)
        if isinstance(step_plan, PlanningFailure):
            return replace(step_plan, error=f"{named}: {step_plan.error}")
        if isinstance(step_plan, NotUnderstood):
            return replace(step_plan, question=f"{named}: {step_plan.question}")
        planned.append(step_plan)
        if not at.went(step_plan.best.examination, step.mission):
            break
    return await _joined(context, task, planned, len(steps))


async def _planned(
    step: MissionContext, read: Understood
) -> PlanForDecision | PlanningFailure | NotUnderstood:
    """Return the judged plan for one step, or its fault or question."""
    retrieved = retrieve(step, step.mission)
    if read.patrol is not None:
        return await plan_patrol(step, retrieved, read.patrol)
    step_plan = await plan(step, retrieved)
    if isinstance(step_plan, PlanningFailure):
        return step_plan
    judged = await judge(step, step_plan)
    return unsettled(judged, read.unsettled) or judged


async def _joined(
    context: MissionContext, task: Mission, planned: Sequence[PlanForDecision], count: int
) -> PlanForDecision:
    """Examine the plans of the steps as one plan; return that plan for decision."""
    bests = [candidate.best for candidate in planned]
    whole = joined_plan(bests)
    number = context.next_attempt()
    context.emit(ev.PlanProposed(attempt=number, author="console", text=whole.answer, plan=whole))
    examination = await safeguards(context, task, whole)
    examination = replace(examination, findings=(*_unplanned(bests, count), *examination.findings))
    if examination.rehearsal is not None and context.services.variant.rehearsal:
        context.emit(
            ev.PlanRehearsed(
                attempt=number, rehearsal=examination.rehearsal, seconds=examination.rehearsal_s
            )
        )
    verdict, error = verdict_on(bests)
    best = Candidate(
        number,
        examination,
        unmet=tuple(
            f"step {step}: {text}"
            for step, candidate in enumerate(bests, start=1)
            for text in candidate.unmet
        ),
        narrowed=any(best.narrowed for best in bests),
        mentions=_mentions(bests),
        verdict=verdict,
        judge_error=error,
        by_server=any(UNTOLD in candidate.all_gaps for candidate in bests),
    )
    context.emit(
        ev.PlanChecked(
            attempt=number,
            findings=examination.findings,
            seconds=examination.checks_s,
            unmet=best.unmet,
            gaps=best.mentions.gaps,
        )
    )
    if context.services.variant.judging and not examination.blocked:
        context.emit(ev.PlanJudged(attempt=number, verdict=verdict, error=error))
    last = planned[-1].answered
    answered = replace(last, retrieved=replace(last.retrieved, task=task, chosen=""))
    return PlanForDecision(answered, best, steps=tuple(planned))


def joined_plan(bests: Sequence[Candidate]) -> Plan:
    """Return the plans of the steps as one plan, in which each step waits for the one before it."""
    actions: list[Action] = []
    reasons: list[str] = []
    before: tuple[int, ...] = ()
    for best in bests:
        first, step_plan = len(actions), best.examination.plan
        for action in step_plan.actions:
            after = tuple(number + first for number in action.after) or before
            actions.append(action.model_copy(update={"after": after}))
        before = tuple(number + first for number in step_plan.steps[-1]) or before
        reasons.append(plain_reading(best.asked) if best.asked else step_plan.reason)
    return Plan(reason="; then ".join(reasons)[:MAX_REASON], actions=tuple(actions))


def _unplanned(bests: Sequence[Candidate], count: int) -> Iterator[Finding]:
    """Yield a critical finding for each step without actions, and one for the unplanned steps."""
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
    """Return the checks of the steps' readings as one, which is baseless if any of them is."""
    checks = [best.mentions for best in bests]
    return MentionCheck(
        tuple(part for check in checks for part in check.mentions),
        tuple(part for check in checks for part in check.unsupported),
        any(check.moves for check in checks),
        any(check.baseless for check in checks),
        tuple(words for check in checks for words in check.times),
    )
