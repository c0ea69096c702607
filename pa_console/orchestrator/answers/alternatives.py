"""Other plans for an order: other readings and other agents, each rehearsed now."""

from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass
from typing import Literal

from pa_console.language.plain_words import plain_reading
from pa_console.orchestrator.answers.planned import asked_of, attempt_of
from pa_console.orchestrator.answers.why_plan import rehearsed_in_words
from pa_console.orchestrator.planning.reading_rehearsal import (
    rehearse_other_ways,
    rehearse_reading,
)
from pa_console.orchestrator.planning.safeguards import CheckBasis
from pa_console.schema.events.questions import AnswerLine
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.session.state.mission_trace import MissionTrace
from pa_console.session.wording import order_in_words

MOST_ALTERNATIVES = 2
"""The number of other plans beside the present one; more when there are more readings."""


@dataclass(frozen=True)
class Alternative:
    """Another plan, for another `reading` of the order or another way to do the same."""

    sort: Literal["reading", "way"]
    asked: str
    found: RehearsedReading

    @property
    def line(self) -> AnswerLine:
        """The plan and the result of its rehearsal, in one line."""
        plan, rehearsal = self.found.plan, self.found.rehearsal
        orders = ", ".join(f"{a.agent} {order_in_words(a)}" for a in plan.actions) or "no command"
        faults = f"; nobody may approve it: {'; '.join(self.found.faults)}"
        bad = faults if self.found.faults else ""
        read = f"read as “{plain_reading(self.asked)}”: " if self.sort == "reading" else ""
        said = f"{read}{orders}; {rehearsed_in_words(rehearsal)}{bad}"
        return AnswerLine(about=f"another {self.sort}", said=said)


async def find_alternatives(basis: CheckBasis, trace: MissionTrace) -> AsyncGenerator[Alternative]:
    """Yield other plans than the one that waits: for other readings, with other agents.

    They are rehearsed in the present picture, and no model is asked.
    """
    attempt, request = attempt_of(trace), trace.approval
    if attempt is None or attempt.plan is None:
        return
    known = 0
    readings: Sequence[str] = request.readings if request is not None else ()
    for asked in readings:
        found = await rehearse_reading(basis, trace.mission, asked)
        if found is not None:
            known += 1
            yield Alternative("reading", asked, found)
    asked = asked_of(trace, attempt)
    if not asked:
        return
    ways = rehearse_other_ways(basis, trace.mission, asked, attempt.plan)
    while known < MOST_ALTERNATIVES:
        found = await anext(ways, None)
        if found is None:
            return
        if _only_holds(found.plan) and not _only_holds(attempt.plan):
            continue
        known += 1
        yield Alternative("way", asked, found)


def _only_holds(plan: Plan) -> bool:
    """Return whether a plan only holds: the console's own way out when nothing can be done."""
    return all(action.verb == "hold" for action in plan.actions)


def order_for(plan: Plan, base: str) -> str:
    """Return in words an order for just what a plan does: who goes where, and who does what."""
    parts: list[str] = []
    for action in plan.actions:
        if action.verb == "move_to":
            parts.append(f"{action.agent} to {action.target}")
        elif action.verb == "return_to_base":
            parts.append(f"{action.agent} to {base}")
        else:
            parts.append(f"{action.agent} {order_in_words(action)}")
    *firsts, last = parts or [""]
    return f"{', '.join(firsts)} and {last}." if firsts else f"{last}." if last else ""
