"""Alternative plans for an order: other readings and other agents, each rehearsed on request."""

import asyncio
from collections.abc import AsyncGenerator, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, product
from typing import Literal

from pa_console.language.canonical.reading import plain_reading, read_asked
from pa_console.llm.roles.grammar import CommandSlot
from pa_console.mission.examine import CheckBasis, examine
from pa_console.mission.planning.choices import commands_serving
from pa_console.schema.events.intake import AnswerLine
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.wording import order_in_words
from pa_console.station.answers.why import asked_of, attempt_of, rehearsed_in_words

MOST_TRIED = 3
"""The largest number of plans that are examined for a reading if rules block the first plans."""


MOST_ASSIGNED = 12
"""The largest number of assignments of agents to the same commands that are tried."""
MOST_ALTERNATIVES = 2
"""The number of alternatives up to which plans with other agents are added to other readings."""


async def rehearse_reading(basis: CheckBasis, task: Mission, words: str) -> RehearsedReading | None:
    """Return the best plan for the reading `words`, rehearsed in the current picture.

    If rules block every plan that is tried, the first one is returned. The result is None if the
    console finds no plan.
    """
    fleet, reading = basis.fleet, read_asked(words)
    if reading is None or not reading.readable:
        return None
    ways = islice(commands_serving(reading, fleet.world, fleet.picture()), MOST_TRIED)
    first: RehearsedReading | None = None
    for slots in await asyncio.to_thread(list, ways):
        plan = Plan(reason="", actions=_assigned(slots))
        examination = await examine(plan, task, fleet, basis.rulebook, variant=basis.variant)
        if examination.rehearsal is None:
            continue
        rehearsed = RehearsedReading(
            plan=plan, rehearsal=examination.rehearsal, faults=examination.faults
        )
        if not examination.blocked:
            return rehearsed
        first = first or rehearsed
    return first


async def rehearse_other_ways(
    basis: CheckBasis, task: Mission, words: str, but: Plan
) -> AsyncGenerator[RehearsedReading]:
    """Yield sound plans for the reading `words`, with other agents than the plan `but`.

    The commands are those of the console's own plan for the reading. No rule blocks a yielded plan.
    Nothing is yielded if the console finds no plan for the reading.
    """
    fleet, reading = basis.fleet, read_asked(words)
    if reading is None or not reading.readable:
        return
    first = await asyncio.to_thread(
        lambda: next(commands_serving(reading, fleet.world, fleet.picture()), ())
    )
    tried = {_orders(but)}
    for actions in islice(_assignments(first), MOST_ASSIGNED):
        plan = Plan(reason=words, actions=actions)
        if _orders(plan) in tried:
            continue
        tried.add(_orders(plan))
        examination = await examine(plan, task, fleet, basis.rulebook, variant=basis.variant)
        if examination.rehearsal is not None and not examination.blocked:
            yield RehearsedReading(
                plan=plan, rehearsal=examination.rehearsal, faults=examination.faults
            )


def _orders(plan: Plan) -> frozenset[tuple[str, str]]:
    return frozenset((action.agent, action.command) for action in plan.actions)


def _assignments(slots: Sequence[CommandSlot]) -> Iterator[tuple[Action, ...]]:
    """Yield the commands with agents, the best assignment first; no agent has two commands."""
    for agents in product(*(slot.agents for slot in slots)):
        if len(set(agents)) == len(agents):
            yield tuple(
                Action(agent=agent, command=slot.command)
                for agent, slot in zip(agents, slots, strict=True)
            )


def _assigned(slots: Sequence[CommandSlot]) -> tuple[Action, ...]:
    """Return the commands with agents; no agent has two commands.

    Each command gets its first agent that has no command yet, starting with the commands that have
    the fewest agents. A command without such an agent is left out.
    """
    given: dict[int, str] = {}
    for at in sorted(range(len(slots)), key=lambda at: len(slots[at].agents)):
        free = (agent for agent in slots[at].agents if agent not in given.values())
        if agent := next(free, ""):
            given[at] = agent
    return tuple(
        Action(agent=given[at], command=slot.command)
        for at, slot in enumerate(slots)
        if at in given
    )


@dataclass(frozen=True)
class Alternative:
    """An alternative plan, for another `reading` of the order or another `way` to carry it out."""

    sort: Literal["reading", "way"]
    asked: str
    found: RehearsedReading

    @property
    def line(self) -> AnswerLine:
        """The plan and the result of its rehearsal, in one line."""
        plan, rehearsal = self.found.plan, self.found.rehearsal
        orders = ", ".join(f"{a.agent} {order_in_words(a)}" for a in plan.actions) or "no command"
        faults = f"; it cannot be approved: {'; '.join(self.found.faults)}"
        bad = faults if self.found.faults else ""
        read = f"read as “{plain_reading(self.asked)}”: " if self.sort == "reading" else ""
        text = f"{read}{orders}; {rehearsed_in_words(rehearsal)}{bad}"
        return AnswerLine(about=f"another {self.sort}", said=text)


async def find_alternatives(basis: CheckBasis, trace: MissionTrace) -> AsyncGenerator[Alternative]:
    """Yield alternatives to the plan of `trace`: first for other readings, then with other agents.

    They are rehearsed in the current picture, and no model is asked.
    """
    attempt, request = attempt_of(trace), trace.approval
    if attempt is None or attempt.plan is None:
        return
    count = 0
    readings: Sequence[str] = request.readings if request is not None else ()
    for words in readings:
        rehearsed = await rehearse_reading(basis, trace.mission, words)
        if rehearsed is not None:
            count += 1
            yield Alternative("reading", words, rehearsed)
    words = asked_of(trace, attempt)
    if not words:
        return
    ways = rehearse_other_ways(basis, trace.mission, words, attempt.plan)
    while count < MOST_ALTERNATIVES:
        rehearsed = await anext(ways, None)
        if rehearsed is None:
            return
        if _only_holds(rehearsed.plan) and not _only_holds(attempt.plan):
            continue
        count += 1
        yield Alternative("way", words, rehearsed)


def _only_holds(plan: Plan) -> bool:
    """Return whether a plan has only holds, which are planned if nothing else is possible."""
    return all(action.verb == "hold" for action in plan.actions)


def order_for(plan: Plan, base: str) -> str:
    """Return an order in words that asks for exactly the actions of a plan."""
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
