"""Rehearses what a reading of an order would lead to, before an operator chooses it.

The console itself says who would do it: no model is asked, nothing is told to the log. Once the
reading is chosen the planner may choose others.
"""

import asyncio
from collections.abc import Sequence
from itertools import islice

from pa_console.llm.roles.grammar import CommandSlot
from pa_console.orchestrator.mission.services import Services
from pa_console.orchestrator.planning.safeguards import examine
from pa_console.orchestrator.tasking.command_choices import commands_serving
from pa_console.orders.reading import read_asked
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import RehearsedReading

MOST_TRIED = 3
"""Plans that are examined at most, where the ones before are blocked."""


async def rehearse_reading(
    services: Services, task: Mission, asked: str
) -> RehearsedReading | None:
    """Return the best plan that serves what was `asked`, rehearsed in the present picture.

    None where the console cannot tell what would serve it.
    """
    fleet, reading = services.fleet, read_asked(asked)
    if reading is None or not reading.readable:
        return None
    ways = islice(commands_serving(reading, fleet.world, fleet.picture()), MOST_TRIED)
    first: RehearsedReading | None = None
    for slots in await asyncio.to_thread(list, ways):
        plan = Plan(reason="", actions=_assigned(slots))
        found = await examine(plan, task, fleet, services.rulebook, variant=services.variant)
        if found.rehearsal is None:
            continue
        rehearsed = RehearsedReading(plan=plan, rehearsal=found.rehearsal, faults=found.faults)
        if not found.blocked:
            return rehearsed
        first = first or rehearsed
    return first


def _assigned(slots: Sequence[CommandSlot]) -> tuple[Action, ...]:
    """Return the commands with the first agent of each that has none; nobody has two."""
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
