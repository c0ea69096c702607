"""What plans that serve an order are made of: its commands, and who of the assets has each.

What serves one wish alone is told by `serving_units.py`; here it is put together, so that nobody
has two commands, every gate keeps its guard, and as much of the order is served as can be. Who of
those that could go does go is left to the model.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations, islice

from pa_console.llm.reading import Reading
from pa_console.llm.slot_grammar import Slot
from pa_console.orchestrator.hindrance import hindrance
from pa_console.orchestrator.reporters import of_everyone, reporters
from pa_console.orchestrator.serving_backfill import bare_s, besides
from pa_console.orchestrator.serving_stands import Stands, Unit, UntoldError
from pa_console.orchestrator.serving_units import units
from pa_console.policy.context import goes_to
from pa_console.schema.plan import MAX_ACTIONS, Action, Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World

_NOTHING = Plan(reason="nothing yet", actions=())
_TRIED = 100
"""Ways to give the commands of a part of an order to assets that are looked at."""
_WAYS = 12
"""Of those that keep every gate covered, how many the model is given to choose from."""
_PARTS = 40
"""Parts of an order that are looked at, the largest first."""

Way = tuple[Action, ...]


def servings(reading: Reading, world: World, picture: Picture) -> Iterator[tuple[Slot, ...]]:
    """Yield the commands of plans that serve `reading`, each with who may have it, best first.

    What can all be done is, and else as much as can: what only looks ahead is given up first, then
    what was asked last. Of each part, the model's choice comes before the console's own. Those that
    cover a gate come first (WF-03). At last, or where nothing can be done, somebody holds. Nothing
    is yielded where the console cannot tell what serves the order.
    """
    named = (n for wish in reading.wishes for n in (*wish.team.names, wish.leaving) if n)
    stands = Stands(world, picture, _NOTHING, frozenset(named))
    due = [wish for wish in reading.wishes if not hindrance(wish, world, picture)]
    try:
        found = [unit for wish in due for unit in units(stands, wish)]
    except UntoldError:
        return
    called = [name for wish in due if of_everyone(wish) for name in reporters(wish, picture)]
    for part in _parts(found[:MAX_ACTIONS]) if found or called else []:
        slots = [slot for unit in part for slot in unit.slots]
        for late in (False, True):
            ways = _ways(stands, slots, called, others_stay=reading.others_stay, late=late)
            if looked_at := list(islice(ways, _WAYS)):
                looked_at.sort(key=lambda way: _late_s(stands, way))
                yield from _chosen(looked_at)
                break
    yield (Slot(tuple(name for name, a in picture.assets.items() if a.available), "hold"),)


def _parts(found: Sequence[Unit]) -> list[list[Unit]]:
    """Return parts of what serves an order, the largest first, and at first all of it."""
    number = len(found)
    left_out = (
        sorted(
            combinations(range(number), count),
            key=lambda out: (sum(not found[i].ahead for i in out), [-i for i in reversed(out)]),
        )
        for count in range(max(number, 1))
    )
    every = (out for some in left_out for out in some)
    return [[unit for i, unit in enumerate(found) if i not in out] for out in islice(every, _PARTS)]


def _chosen(ways: Sequence[Way]) -> Iterator[tuple[Slot, ...]]:
    """Yield what `ways` leave open to choice, and then the first of them as it is."""
    first = ways[0]
    commands = [action.command for action in first]
    alike = [way for way in ways if [action.command for action in way] == commands]
    names = (dict.fromkeys(way[i].agent for way in alike) for i in range(len(first)))
    yield tuple(Slot(tuple(n), said) for n, said in zip(names, commands, strict=True))
    if len(alike) > 1:
        yield tuple(Slot((action.agent,), action.command) for action in first)


def _ways(
    stands: Stands, slots: Sequence[Slot], called: Sequence[str], *, others_stay: bool, late: bool
) -> Iterator[Way]:
    """Yield plans in which everybody has one command at most and no gate is left.

    Those `called` report if they have nothing else to do. With `late`, gates may wait for whoever
    takes them over.
    """
    for given in islice(_given(slots), _TRIED):
        goals = _goals(stands, given)
        for more in besides(stands, goals, others_stay=others_stay, late=late):
            first = [Action(agent=name, command=said) for name, said in more]
            busy = {*goals, *(name for name, _ in more)}
            told = (Action(agent=n, command="report") for n in called if n not in busy)
            if way := (*first, *given, *told)[:MAX_ACTIONS]:
                yield way


def _goals(stands: Stands, actions: Sequence[Action]) -> dict[str, str]:
    """Return where everybody is who has a command, once it is carried out."""
    ends = ((action.agent, goes_to(action, stands.world)) for action in actions)
    return {name: goal or stands.post(name) for name, goal in ends}


def _late_s(stands: Stands, way: Way) -> float:
    """Return how long the gates that their guards leave wait for others at least, in seconds."""
    return bare_s(stands, _goals(stands, way))


def _given(slots: Sequence[Slot], had: tuple[Action, ...] = ()) -> Iterator[tuple[Action, ...]]:
    """Yield the ways to give each of `slots` to somebody who has none yet."""
    number = len(had)
    if number == len(slots):
        yield had
        return
    agents, command = slots[number]
    if number and slots[number] == slots[number - 1]:
        agents = agents[agents.index(had[-1].agent) + 1 :]
    busy = {action.agent for action in had}
    for name in agents:
        if name not in busy:
            yield from _given(slots, (*had, Action(agent=name, command=command)))
