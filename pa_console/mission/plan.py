"""Steps 3 to 6 of a mission: from its rules to a plan that was checked, rehearsed and judged."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pa_console.language.mention_check import NOTHING_SAID, MentionCheck, check_mentions
from pa_console.language.order import Reading
from pa_console.language.reading import agree, asked_words, read_asked, read_reason
from pa_console.llm.roles.clause_reader import ClauseReader, ask_what_is_asked
from pa_console.llm.roles.judge import Judge, OrderRead
from pa_console.mission.candidate import Candidate, ReadAgain, better, fulfilment_of
from pa_console.mission.context import MissionContext
from pa_console.mission.examine import Examination, examine
from pa_console.mission.judge import PlanCase, ask_about_plan, judge_plan
from pa_console.mission.propose import (
    Answered,
    Attempt,
    Instead,
    ask_for_others,
    ask_planner,
    ask_who,
    commands_for,
)
from pa_console.mission.understand import Retrieved
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal

DOUBT = 0.8
"""Below this confidence of planner or judge, an order is read again. Of 398 orders in people's
words that neither model had met, the planner read 62 of the 206 below it as meant and the second
reader 118; of the 192 above it, 177 and 175."""

PATIENCE_S = 15.0
"""The longest wait for the second reader, its loading included, seconds; then the plan is proposed
without it."""

LEAST = 0.3
"""Below this confidence of its own, the second reader's reading is only offered."""


def in_doubt(shown: Candidate) -> bool:
    """Return whether an order should be read again before its plan is proposed.

    It should if a model was unsure, the judge objects, or words of the order are left over. A plan
    that is blocked, and one that the operator wrote, is not put in doubt.
    """
    if shown.own or shown.examination.blocked or shown.sure is None:
        return False
    return shown.sure < DOUBT or shown.objected or bool(shown.mentions.gaps)


async def read_again(context: MissionContext, case: PlanCase, shown: Candidate) -> Candidate:
    """Return `shown` with the second reader's reading; unchanged without an answer."""
    services, world = context.services, context.services.fleet.world
    reader = services.server_reader or services.second_reader
    if reader is None or not services.variant.read_again or not in_doubt(shown):
        return shown
    with context.stopwatch.time("readings_s"):
        try:
            async with asyncio.timeout(PATIENCE_S):
                if isinstance(reader, ClauseReader):
                    read = await reader.read(ask_what_is_asked(world, case.digest, case.task))
                else:
                    question = ask_about_plan(
                        services.prompt_format, world, services.rulebook, case
                    )
                    read = await reader.read(question)
        except TimeoutError:
            read = OrderRead("", f"no answer within {PATIENCE_S:.0f} s")
    context.emit(
        ev.OrderReadAgain(
            attempt=shown.attempt,
            model=reader.model,
            asked=read.asked,
            error=read.error,
            usage=read.usage,
            confidence=read.confidence,
        )
    )
    measured = isinstance(reader, Judge)
    if not read.asked or (measured and read.confidence is None):
        return shown
    own, sure = asked_words(shown.examination.plan.reason).rstrip("; "), read.confidence or 0.0
    same = agree(own, read.asked, world.base)
    again = ReadAgain(read.asked, sure, same=same, measured=measured)
    return replace(shown, read_again=again)


def likelier(shown: Candidate) -> bool:
    """Return whether the second reader's reading is likelier than that of the plan on show.

    If an order is in doubt, it is right twice as often as the planner.
    """
    read = shown.read_again
    return read is not None and read.measured and not read.same and read.confidence >= LEAST


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


async def judge(context: MissionContext, planned: Planned) -> Planned:
    """Step 6: ask for the JudgeLLM's verdict on the plan to decide on; a blocked plan needs none.

    A trained judge reads the order for itself. Where it objects and its reading is the likelier
    one, a plan that serves that becomes the one to decide on, if nothing blocks it and the judge
    passes it.
    """
    answered = planned.answered
    first = await _judged(context, answered, planned.best)
    asked = first.second_reading
    if asked and context.services.variant.second_reading:
        other = await _with_commands_given(
            context, answered, asked, read_asked(asked), first, instead="judged"
        )
        if other is not first:
            other = await _judged(context, answered, other)
        first = first if other.objected else other
    return replace(planned, best=await _as_read_again(context, answered, first))


async def _as_read_again(
    context: MissionContext, answered: Answered, shown: Candidate
) -> Candidate:
    """Let another model read an order that is in doubt; where it is surer, its reading is served.

    The judge is then told what was asked: it judges the plan for that. Where both readings come to
    the same orders, there is nothing to choose between: the second reader bears the plan out.
    """
    if answered.retrieved.chosen or shown.examination.rehearsal is None:
        return shown
    shown = await read_again(context, _case(answered, shown, shown.examination.rehearsal), shown)
    second = shown.read_again
    if second is None or not likelier(shown):
        return shown
    reading = read_asked(second.asked)
    other = await _with_commands_given(
        context, answered, second.asked, reading, shown, instead="read_again"
    )
    if other is shown or other.examination.blocked:
        return shown
    if other.mentions.gaps and not shown.mentions.gaps:
        return shown  # what accounts for every word is not given up for what does not
    if not shown.objected and other.does_as(shown):
        return replace(shown, read_again=replace(second, same=True))
    other = await _judged(context, answered, other, second.asked)
    return shown if other.objected else replace(other, read_again=replace(second, same=True))


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
        best = await _with_commands_given(context, answered, answered.said, reading, best)
    return best


async def _with_commands_given(
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


async def _judged(
    context: MissionContext, answered: Answered, candidate: Candidate, asked: str = ""
) -> Candidate:
    """Return `candidate` with its verdict; the judge reads the order unless it is told `asked`."""
    found = candidate.examination
    if found.blocked or found.rehearsal is None or not context.services.variant.judging:
        return candidate
    case = _case(answered, candidate, found.rehearsal)
    return await judge_plan(context, replace(case, asked=asked or case.asked), candidate)


def _case(answered: Answered, candidate: Candidate, rehearsal: Rehearsal) -> PlanCase:
    found, question = candidate.examination, answered.question
    return PlanCase(
        answered.retrieved.task,
        answered.retrieved.hits,
        question.digest,
        found.plan,
        found.findings,
        rehearsal,
        question.asked,
    )


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
