"""The reasons against another asset: the plan is checked and rehearsed again with it in place.

That uses the present picture. If the mission is over, the facts of the picture at planning time
come first. No decision follows from it.
"""

from collections.abc import AsyncGenerator, Iterator, Sequence

from pa_console.mission.examine import CheckBasis, Examination, examine
from pa_console.schema.events.intake import AnswerLine
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import PLAIN_KINDS, World
from pa_console.session.mission_trace import Attempt, MissionTrace
from pa_console.session.wording import order_in_words
from pa_console.station.why import (
    actions_of,
    against,
    asked_of,
    distance_m,
    goal_of,
    is_able,
    kind_asked_for,
    rehearsed_in_words,
    who_is_able,
)

MOST_CHECKED = 4
"""The number of named assets that are checked; of more, the nearest."""


async def why_not_lines(
    basis: CheckBasis, trace: MissionTrace, attempt: Attempt, names: Sequence[str]
) -> AsyncGenerator[AnswerLine]:
    """Yield for each of `names` what stands against it in place of who has its part."""
    world, actions = basis.fleet.world, actions_of(attempt)
    planned = {action.agent: action for action in actions}
    others = [name for name in names if name not in planned]
    for name in names:
        if name in planned and (len(names) == 1 or not others):
            said = f"it is in the plan: {order_in_words(planned[name])}"
            yield AnswerLine(about=name, said=said)
    nearest = sorted(others, key=lambda name: _nearness(name, actions, world, basis))
    for name in nearest[:MOST_CHECKED]:
        async for said in _checked(basis, trace, attempt, name):
            yield AnswerLine(about=name, said=said)
    if len(nearest) > MOST_CHECKED:
        said = f"{len(nearest) - MOST_CHECKED} more are farther away and were not checked"
        yield AnswerLine(about="and", said=said)


def part_for(name: str, actions: Sequence[Action], world: World) -> Action | None:
    """Return whose part an asset would have: that of one of its kind, else one that it can do.

    None where nobody does anything, or nothing that it can do.
    """
    movers = [each for each in actions if goal_of(each, world)]
    able = [each for each in movers or actions if is_able(name, each, world)]
    kind = world.assets[name].kind
    alike = [each for each in able if each.agent in world.assets]
    alike = [each for each in alike if world.assets[each.agent].kind == kind]
    return next(iter((*alike, *able)), None)


def _nearness(name: str, actions: Sequence[Action], world: World, basis: CheckBasis) -> float:
    part, picture = part_for(name, actions, world), basis.fleet.picture()
    found = distance_m(name, part, world, picture) if part is not None else None
    return float("inf") if found is None else found


async def _checked(
    basis: CheckBasis, trace: MissionTrace, attempt: Attempt, name: str
) -> AsyncGenerator[str]:
    """Yield the facts against one asset, and the results of checks and rehearsal with it."""
    world, actions = basis.fleet.world, actions_of(attempt)
    part = part_for(name, actions, world)
    if part is None:
        first = next((each for each in actions if goal_of(each, world)), None)
        yield who_is_able(first) if first is not None else "the plan sends nobody anywhere"
        return
    over = trace.approval is None
    then = attempt.rehearsal.before if attempt.rehearsal is not None else None
    if over and then is not None:
        yield f"when it was planned: {_facts(name, part, attempt, trace, world, then)}"
    now = basis.fleet.picture()
    with_it = Plan(
        reason=attempt.plan.reason if attempt.plan is not None else "",
        actions=tuple(
            each.model_copy(update={"agent": name}) if each is part else each for each in actions
        ),
    )
    found = await examine(
        with_it, trace.mission, basis.fleet, basis.rulebook, variant=basis.variant
    )
    if not over:
        yield _facts(name, part, attempt, trace, world, now)
    yield f"{'now ' * over}in place of {part.agent}: {_verdict(found)}"
    if found.rehearsal is not None:
        compared = attempt.rehearsal if not over else None
        yield _arrival(name, part, found.rehearsal, compared)


def _facts(  # noqa: PLR0917 - one asset in one plan, in one picture
    name: str, part: Action, attempt: Attempt, trace: MissionTrace, world: World, picture: Picture
) -> str:
    """Return the facts in a picture and in the order against an asset in that part of the plan."""
    told = [*_not_asked_for(name, part, attempt, trace, world), *against(name, picture)]
    own_m = distance_m(name, part, world, picture)
    their_m = distance_m(part.agent, part, world, picture)
    if own_m is not None and their_m is not None:
        told.append(f"{own_m:.0f} m away, {part.agent} {their_m:.0f} m")
    return "; ".join(told) or "nothing in the picture stands against it"


def _not_asked_for(
    name: str, part: Action, attempt: Attempt, trace: MissionTrace, world: World
) -> Iterator[str]:
    """Yield that the order was read as one for another kind."""
    kind = kind_asked_for(asked_of(trace, attempt), part, world)
    if kind is not None and world.assets[name].kind != kind:
        yield f"the order was read as one for a {PLAIN_KINDS[kind]}"


def _verdict(found: Examination) -> str:
    if found.blocked:
        return f"nobody may approve it: {'; '.join(found.faults)}"
    if found.broken:
        return f"a warning: {'; '.join(found.broken)}"
    return "no rule is broken"


def _arrival(name: str, part: Action, found: Rehearsal, planned: Rehearsal | None) -> str:
    """Return how the rehearsal with the asset goes, and when it and the planned one arrive."""
    arrived_s = found.motion.arrived_s.get(name)
    there = f"; it is there after {arrived_s:.0f} s" if arrived_s is not None else ""
    other_s = planned.motion.arrived_s.get(part.agent) if planned is not None else None
    if there and other_s is not None:
        there += f", {part.agent} after {other_s:.0f} s"
    return f"rehearsed: {rehearsed_in_words(found)}{there}"
