"""Steps 3 to 6 of a mission: from its rules to a plan that was checked, rehearsed and judged."""

from collections.abc import Sequence
from dataclasses import dataclass

from pa_console.language.mention_check import NOTHING_SAID, MentionCheck, check_mentions
from pa_console.language.order import Reading
from pa_console.language.reading import asked_words, read_asked, read_reason
from pa_console.mission.candidate import Candidate, better, fulfilment_of
from pa_console.mission.context import MissionContext
from pa_console.mission.examine import Examination, examine
from pa_console.mission.propose import (
    Answered,
    Attempt,
    Instead,
    ask_for_others,
    ask_planner,
    ask_who,
    commands_for,
)
from pa_console.mission.retrieve import Retrieved
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan

MOST_SERVED = 6
"""The number of plans with the console's own commands that are tried, while the earlier ones are
blocked."""


@dataclass(frozen=True)
class Planned:
    """The plan to decide on, and the planner's answer for its task."""

    answered: Answered
    best: Candidate


@dataclass(frozen=True)
class Unplanned:
    """The planner gave no plan; `error` says why."""

    answered: Answered
    error: str


async def plan(
    context: MissionContext, retrieved: Retrieved, reasons: Sequence[str] = (), previous: str = ""
) -> Planned | Unplanned:
    """Steps 3 to 6: ask for a plan until nothing blocks it, at most 1 + repairs times.

    `reasons` say what was wrong with the `previous` plan. The least bad plan is the one to decide
    on; a mere warning is for the operator to acknowledge. A model that says only what is asked is
    not asked again for plans that the console has made: an order means the same when they are
    blocked.
    """
    best: Candidate | None = None
    reading: Reading | None = None
    error, seen, left = "", set[Plan](), context.services.variant.repairs
    while True:
        answered = await ask_planner(context, retrieved, reasons, previous)
        proposal = answered.proposal
        answer = proposal.text
        if proposal.plan is None:
            error, reasons = proposal.error, (proposal.error,)
        else:
            if context.services.variant.fitting:
                reading = reading or _read(answered, proposal.plan)
            attempt = Attempt(
                answered.attempt,
                proposal.plan,
                proposal.confidence,
                answered.model.server is not None,
            )
            sent_back = await _examined(context, retrieved, attempt, reading)
            best = better(best, sent_back)
            if not best.sound and not seen:
                best = await _first_sound(context, answered, reading, best)
            if best.attempt > sent_back.attempt:
                sent_back = best
            reasons = sent_back.examination.faults if best.examination.blocked else ()
            answer = sent_back.examination.plan.answer
        again = not proposal.fatal and left > 0 and proposal.plan not in seen
        if not (again and reasons) or (
            answered.model.prompt_format.served and proposal.plan is not None
        ):
            break
        left -= 1
        if proposal.plan is not None:
            seen.add(proposal.plan)
        previous = answer
        context.emit(ev.RepairRequested(attempt=context.attempts, reasons=tuple(reasons)))
    if best is None:
        return Unplanned(answered, error)
    return Planned(answered, best)


async def take(context: MissionContext, answered: Answered, written: Plan) -> Planned:
    """Step 6 for a plan that the operator wrote: it is examined like any other."""
    number = context.next_attempt()
    context.emit(
        ev.PlanProposed(attempt=number, author="operator", text=written.answer, plan=written)
    )
    retrieved = answered.retrieved
    candidate = await _examined(context, retrieved, Attempt(number, written), None, own=True)
    return Planned(answered, candidate)


async def reexamine(context: MissionContext, task: Mission, approved: Plan) -> Examination | None:
    """Examine an `approved` plan in the present state; None when it may still be executed."""
    fresh = await _safeguards(context, task, approved)
    return fresh if fresh.blocked else None


async def _first_sound(
    context: MissionContext, answered: Answered, reading: Reading | None, best: Candidate
) -> Candidate:
    """Examine the planner's other answers until one is sound; return the best of them all.

    Where the console can read what its first answer says was asked, the others say the same of
    it; with none of them sound, it is given the commands and says who has them.
    """
    readable = reading is not None and reading.readable
    for other in await ask_for_others(context, answered, as_asked=readable):
        if best.sound:
            break
        best = better(best, await _examined(context, answered.retrieved, other, reading))
    if readable and not best.sound:
        best = await with_commands_given(context, answered, answered.said, reading, best)
    return best


async def with_commands_given(
    context: MissionContext,
    answered: Answered,
    asked: str,
    reading: Reading | None,
    best: Candidate,
    *,
    instead: Instead = "",
) -> Candidate:
    """Examine plans for the reading `asked` with the console's own commands.

    They serve less and less of it, until no rule blocks one. The result is the best of them and the
    `best` so far; a sound one in any case, if that is a plan for another `reading` too.
    """
    retrieved = answered.retrieved
    for slots in await commands_for(context, retrieved, asked, MOST_SERVED):
        attempt = await ask_who(context, answered, asked, slots, instead)
        if attempt is None:
            continue
        candidate = await _examined(context, retrieved, attempt, reading)
        best = candidate if candidate.sound else better(best, candidate)
        if not candidate.examination.blocked:
            break
    return best


def _read(answered: Answered, proposed: Plan) -> Reading | None:
    """Return the reading, as far as the console can parse it."""
    if answered.question.asked:
        return read_asked(answered.question.asked)
    return read_reason(proposed.reason)


async def _examined(
    context: MissionContext,
    retrieved: Retrieved,
    attempt: Attempt,
    reading: Reading | None,
    *,
    own: bool = False,
) -> Candidate:
    """Examine a plan; what an operator's `own` is for is not read from the order."""
    found = await _safeguards(context, retrieved.task, attempt.plan)
    world, text = context.services.fleet.world, retrieved.task.text
    fits = fulfilment_of(found, reading, world, text)
    mentions = NOTHING_SAID
    if not own and not retrieved.chosen:
        mentions = _mentions(context, retrieved.task, found, fits.unmet)
    if found.rehearsal is not None and context.services.variant.rehearsal:
        context.emit(
            ev.PlanRehearsed(
                attempt=attempt.number, rehearsal=found.rehearsal, seconds=found.rehearsal_s
            )
        )
    context.emit(
        ev.PlanChecked(
            attempt=attempt.number,
            findings=found.findings,
            seconds=found.checks_s,
            unmet=fits.unmet,
            gaps=mentions.gaps,
        )
    )
    return Candidate(
        attempt.number,
        found,
        fits.gaps,
        fits.unmet,
        fits.narrowed,
        mentions,
        attempt.confidence,
        own=own,
        by_server=attempt.by_server,
    )


def _mentions(
    context: MissionContext, task: Mission, found: Examination, unmet: Sequence[str]
) -> MentionCheck:
    """Compare the words of the task with the plan's reading."""
    fleet, plan_ = context.services.fleet, found.plan
    before = found.rehearsal.before if found.rehearsal is not None else fleet.picture()
    asked = asked_words(plan_.reason).rstrip("; ")
    return check_mentions(fleet.world, before, task.text, asked, plan_, unmet)


async def _safeguards(context: MissionContext, task: Mission, checked: Plan) -> Examination:
    services = context.services
    found = await examine(
        checked,
        task,
        services.fleet,
        services.rulebook,
        context.monitor,
        services.variant,
        context.mission.text,
    )
    context.stopwatch.add("checks_s", found.checks_s)
    context.stopwatch.add("rehearsal_s", found.rehearsal_s)
    return found
