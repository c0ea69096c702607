"""Rehearses what a reading of an order would lead to, before an operator chooses it.

The console itself says who would do it: no model is asked, nothing is told to the log. Once the
reading is chosen the planner may choose others.
"""

import asyncio
from collections.abc import AsyncGenerator, Iterator, Sequence
from itertools import islice, product

from pa_console.language.reading import read_asked
from pa_console.llm.roles.grammar import CommandSlot
from pa_console.orchestrator.planning.safeguards import CheckBasis, examine
from pa_console.orchestrator.tasking.command_choices import commands_serving
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import RehearsedReading

MOST_TRIED = 3
"""Plans that are examined at most, where the ones before are blocked."""


MOST_ASSIGNED = 12
"""The number of assignments of the same commands that are tried for alternatives."""


async def rehearse_reading(basis: CheckBasis, task: Mission, asked: str) -> RehearsedReading | None:
    """Return the best plan for the reading `asked`, rehearsed in the present picture.

    None if the console cannot find one.
    """
    fleet, reading = basis.fleet, read_asked(asked)
    if reading is None or not reading.readable:
        return None
    ways = islice(commands_serving(reading, fleet.world, fleet.picture()), MOST_TRIED)
    first: RehearsedReading | None = None
    for slots in await asyncio.to_thread(list, ways):
        plan = Plan(reason="", actions=_assigned(slots))
        found = await examine(plan, task, fleet, basis.rulebook, variant=basis.variant)
        if found.rehearsal is None:
            continue
        rehearsed = RehearsedReading(plan=plan, rehearsal=found.rehearsal, faults=found.faults)
        if not found.blocked:
            return rehearsed
        first = first or rehearsed
    return first


async def rehearse_other_ways(
    basis: CheckBasis, task: Mission, asked: str, but: Plan
) -> AsyncGenerator[RehearsedReading]:
    """Yield sound plans for the reading `asked` with other agents than the plan `but`.

    The commands are those that the console itself would give, and no rule blocks a yielded plan.
    None if the console cannot find one.
    """
    fleet, reading = basis.fleet, read_asked(asked)
    if reading is None or not reading.readable:
        return
    first = await asyncio.to_thread(
        lambda: next(commands_serving(reading, fleet.world, fleet.picture()), ())
    )
    known = {_orders(but)}
    for actions in islice(_assignments(first), MOST_ASSIGNED):
        plan = Plan(reason=asked, actions=actions)
        if _orders(plan) in known:
            continue
        known.add(_orders(plan))
        found = await examine(plan, task, fleet, basis.rulebook, variant=basis.variant)
        if found.rehearsal is not None and not found.blocked:
            yield RehearsedReading(plan=plan, rehearsal=found.rehearsal, faults=found.faults)


def _orders(plan: Plan) -> frozenset[tuple[str, str]]:
    return frozenset((action.agent, action.command) for action in plan.actions)


def _assignments(slots: Sequence[CommandSlot]) -> Iterator[tuple[Action, ...]]:
    """Yield who may have each of the commands, the best first; nobody has two."""
    for agents in product(*(slot.agents for slot in slots)):
        if len(set(agents)) == len(agents):
            yield tuple(
                Action(agent=agent, command=slot.command)
                for agent, slot in zip(agents, slots, strict=True)
            )


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
