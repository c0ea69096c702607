"""Step 6 of a mission: each reader's reading of an order, and the likeliest reading.

Planner and judge read every order; the second reader reads an order that is in doubt. Equivalent
readings count as one. The confidence in each reading follows from the evidence for all of them
(`session/confidence.py`).
"""

import asyncio
from collections.abc import Sequence
from typing import NamedTuple

from pa_console.language.canonical.reading import agree, read_asked
from pa_console.language.mention_check import MentionCheck, check_mentions
from pa_console.llm.roles.clause_reader import ClauseReader, ask_what_is_asked
from pa_console.llm.roles.grammar import PLANNED
from pa_console.llm.roles.judge import Judge, JudgeQuestion, OrderReading
from pa_console.mission.context import MissionContext
from pa_console.mission.plan import Candidate
from pa_console.mission.planning.fulfilment import gaps
from pa_console.mission.planning.moves import PlanMoves
from pa_console.mission.planning.obstacles import unmet_asks
from pa_console.mission.planning.propose import PlannerAnswer, commands_for, served_plan
from pa_console.schema.evaluation import Variant
from pa_console.schema.events import event as ev
from pa_console.schema.plan import Plan
from pa_console.session.confidence import Evidence, Reader, WeighedReading, weighed

DOUBT = 0.8
"""The confidence of planner or judge below which an order is read again.

The bound was chosen on 398 orders in people's words that were new to both models. Of the 206 orders
below it, the planner read 62 correctly and the second reader 118. Of the 192 above it, the planner
read 177 correctly and the second reader 175.
"""

PATIENCE_S = 15.0
"""The longest wait for the second reader, in seconds, including the time to load it. After that,
the plan is proposed without its reading."""


class ReaderAnswer(NamedTuple):
    """The reading of one reader, in canonical words."""

    reader: Reader
    asked: str
    chance: float | None = None
    """The reader's own confidence; None if it has none, or if its confidence is not calibrated."""


def in_doubt(shown: Candidate) -> bool:
    """Return whether an order should be read again before its plan is proposed.

    It should if a model was unsure, the judge objects, or words of the order are unused. An order
    is never in doubt if its plan is blocked or was not written by a model.
    """
    if shown.own or shown.examination.blocked or shown.sure is None:
        return False
    return shown.sure < DOUBT or shown.objected or bool(shown.mentions.gaps)


async def _read_again(
    context: MissionContext, answered: PlannerAnswer, shown: Candidate, question: JudgeQuestion
) -> list[ReaderAnswer]:
    """Return the second reader's answer to an order in doubt, in a list; empty without an answer.

    A second reader that is a judge gets the judge's `question` about the plan. An order that refers
    to the previous one is not read again, because the second reader was not trained on such orders.
    """
    services, task = context.services, answered.retrieved.task
    reader = services.server_reader or services.second_reader
    if reader is None or task.follows or not services.variant.read_again or not in_doubt(shown):
        return []
    with context.stopwatch.time("readings_s"):
        try:
            async with asyncio.timeout(PATIENCE_S):
                if isinstance(reader, ClauseReader):
                    digest = answered.question.digest
                    order_question = ask_what_is_asked(services.fleet.world, digest, task)
                    read = await reader.read(order_question)
                else:
                    read = await reader.read(question)
        except TimeoutError:
            read = OrderReading("", f"no answer within {PATIENCE_S:.0f} s")
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
        return []
    return [ReaderAnswer("second", read.asked, read.confidence if measured else None)]


async def read_order(
    context: MissionContext, answered: PlannerAnswer, shown: Candidate, question: JudgeQuestion
) -> tuple[WeighedReading, ...]:
    """Return the readings of an order, the likeliest first.

    The planner's reading is that of the judged plan `shown`, and `question` is the judge's question
    about that plan. If the plan also serves another reader's reading, the two count as one.
    """
    world, task = context.services.fleet.world, answered.retrieved.task
    text, follows = task.text, task.follows
    rehearsal = shown.examination.rehearsal
    before = rehearsal.before if rehearsal is not None else context.services.fleet.picture()
    answers = [ReaderAnswer("planner", shown.asked, shown.confidence)]
    feedback = (
        shown.verdict.feedback.partition(PLANNED) if shown.verdict is not None else ("", "", "")
    )
    if feedback[1]:
        answers.append(ReaderAnswer("judge", feedback[0], shown.judge_confidence))
    answers += await _read_again(context, answered, shown, question)
    groups = [answers[:1]]
    for answer in answers[1:]:
        for group in groups:
            if _same(group[0].asked, answer.asked, world.base):
                group.append(answer)
                break
        else:
            if _serves(PlanMoves(world, before, shown.examination.plan), shown, answer.asked, text):
                groups[0].append(answer)
            else:
                groups.append([answer])
    readings = [_with_evidence(answers[0], groups[0], shown.mentions)]
    for group in groups[1:]:
        first = max(group, key=lambda answer: answer.chance or 0.0)
        plan = await foreseen(context, answered, first.asked)
        words = context.as_described(text, first.asked)
        check = check_mentions(world, before, words, first.asked, plan, follows=follows)
        readings.append(_with_evidence(first, group, check))
    return weighed(readings)


def may_decide(variant: Variant, reading: WeighedReading, own: WeighedReading) -> bool:
    """Return whether a plan for `reading` may replace the plan for the planner's `own` reading.

    It may if the readers of both readings report a calibrated confidence. The judge's reading needs
    no confidence if it has fewer gaps than the planner's.
    """
    measured = bool(own.evidence.chances) and bool(reading.evidence.chances)
    if reading.reader != "judge":
        return measured
    return variant.second_reading and (measured or reading.evidence.gaps < own.evidence.gaps)


def _same(first: str, other: str, base: str) -> bool:
    """Return whether two readings are equivalent; unparsable readings must be equal as text."""
    return first == other or agree(first, other, base)


def _with_evidence(
    first: ReaderAnswer, group: Sequence[ReaderAnswer], check: MentionCheck
) -> WeighedReading:
    """Return the reading that the answers in `group` share, in the words of the answer `first`."""
    chance = {answer.reader: answer.chance for answer in group}
    chances = chance.get("planner"), chance.get("judge"), chance.get("second")
    return WeighedReading(first.asked, first.reader, Evidence(*chances, gaps=len(check.gaps)))


def _serves(moves: PlanMoves, shown: Candidate, reading_text: str, text: str) -> bool:
    """Return whether the plan `shown`, with its `moves`, does all of a reading and no more.

    Returns False for a plan that only holds, or that has gaps of its own.
    """
    reading = read_asked(reading_text)
    still = all(action.verb == "hold" for action in moves.plan.actions)
    if reading is None or still or shown.gaps or shown.narrowed or shown.mentions.gaps:
        return False
    return not gaps(moves, reading) and all(
        part.fulfilled for part in unmet_asks(moves, reading, text)
    )


async def foreseen(context: MissionContext, answered: PlannerAnswer, reading: str) -> Plan:
    """Return the console's plan for a reading; it has no actions if the console cannot make one."""
    ways = await commands_for(context, answered.retrieved, reading, 1)
    if not ways:
        return Plan(reason=reading, actions=())
    return served_plan(reading, ways[0], answered.question.digest)
