"""Step 6: another model reads an order again of which planner or judge is unsure.

Planner and judge share their weights, and so their misreadings. The second reader is a larger model
of another family: it is asked only where there is doubt, so that a clear order costs no more time.
It says what was asked and nothing else; the plan for that goes the same way as any other. One that
was not trained for orders, or is on a server, is not measured: what it reads is offered, makes no
doubt less and decides nothing.
"""

import asyncio
from dataclasses import replace

from pa_console.language.distinct_readings import agree
from pa_console.language.reading import asked_words
from pa_console.llm.roles.clause_reader import ClauseReader, ask_what_is_asked
from pa_console.llm.roles.judge import Judge, OrderRead
from pa_console.orchestrator.mission.services import MissionContext
from pa_console.orchestrator.planning.candidate import Candidate, ReadAgain
from pa_console.orchestrator.planning.judging import PlanCase, ask_about_plan
from pa_console.schema.events import event as ev

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
                    question = ask_about_plan(services.dialect, world, services.rulebook, case)
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
