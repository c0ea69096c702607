"""The commands of plans for a reading, and the candidate agents for each command.

A contact is first observed from the air, then identified, then warned. It is blocked only if it is
hostile and was warned. Noncombatants are only watched (ROE-08). A plan has only the steps that are
due now; the workflow adds the others later. This module makes commands from a reading, and
`fulfilment.py` compares a plan with a reading.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, islice
from typing import NamedTuple

from pa_console.language.canonical.order import Ask, Reading, Task
from pa_console.llm.roles.grammar import CommandSlot
from pa_console.mission.planning.backfill import (
    StandingAssets,
    backfill_commands,
    bare_s,
    but_guards,
)
from pa_console.mission.planning.fulfilment import is_to_be_warned, of_everyone, reporters
from pa_console.mission.planning.obstacles import (
    is_of,
    obstacle_to,
    unfit,
    within_capability,
)
from pa_console.policy.rule_variables import goes_to
from pa_console.schema.plan import MAX_ACTIONS, Action, Plan
from pa_console.schema.telemetry import Picture, Track
from pa_console.schema.world import World

_NOTHING = Plan(reason="nothing yet", actions=())
_TRIED = 100
"""The number of assignments of agents that are tried for one part of an order."""
_WAYS = 12
"""The number of assignments that keep every gate covered, among which the model chooses."""
_PARTS = 40
"""The number of parts of an order that are tried, largest first."""


Way = tuple[Action, ...]


class NotInPictureError(Exception):
    """An error: the plan for an ask depends on facts that the picture does not show."""


class CommandUnit(NamedTuple):
    """Commands for a part of an order that are given together or not at all."""

    slots: tuple[CommandSlot, ...]
    ahead: bool = False
    """True for the observation of a place without a known contact; such units are dropped first."""


def units_of_one(slots: Iterable[CommandSlot]) -> Iterator[CommandUnit]:
    """Yield each slot as a unit of its own."""
    yield from (CommandUnit((slot,)) for slot in slots)


def one_unit(slots: Iterable[CommandSlot]) -> Iterator[CommandUnit]:
    """Yield all slots as one unit, if there are any slots."""
    if every := tuple(slots):
        yield CommandUnit(every)


def identify_units(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    """Yield the identification of a contact; a drone first observes an unobserved one (WF-02)."""
    yield _only_looked_at(stands, ask.place) or _identified(stands, ask)


def encounter_units(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    """Yield the next command for a contact; without a known contact, a drone observes the place."""
    tracks = stands.tracks(ask.place)
    if look := _only_looked_at(stands, ask.place):
        yield look
    elif any(_is_stranger(track) for track in tracks):
        at_once = ask.task == "warn" or all(track.observed for track in tracks)
        yield _identified(stands, ask) if at_once else CommandUnit(_look(stands, ask.place))
    elif any(map(is_to_be_warned, tracks)):
        yield CommandUnit((CommandSlot(_robots(stands, ask), f"warn {ask.place}"),))
    else:
        raise NotInPictureError


def block_units(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    """Yield the block of a lane, or what must come before it for the tracks there (WF-01)."""
    if all(map(_may_block, stands.tracks(ask.place))):
        if ask.who.names:
            yield from (
                CommandUnit((CommandSlot((n,), f"block {ask.place}"),)) for n in stands.fit(ask)
            )
        elif vehicles := stands.near(ask.place, "ugv"):
            yield CommandUnit((CommandSlot(vehicles, f"block {ask.place}"),))
    else:
        yield from encounter_units(
            stands, replace(ask, task="respond", who=replace(ask.who, names=()))
        )


def _is_stranger(track: Track) -> bool:
    return track.identity == "unknown" and track.status != "leaving"


def _may_block(track: Track) -> bool:
    is_hostile = track.identity == "unauthorized" and track.warned and track.intent == "hostile"
    return is_hostile and not track.noncombatants


def _identified(stands: StandingAssets, ask: Ask) -> CommandUnit:
    look = () if all(t.observed for t in stands.tracks(ask.place)) else _look(stands, ask.place)
    return CommandUnit((*look, CommandSlot(_robots(stands, ask), f"identify {ask.place}")))


def _only_looked_at(stands: StandingAssets, place: str) -> CommandUnit | None:
    """Return an observation if no contact is known or noncombatants are suspected, else None."""
    tracks = stands.tracks(place)
    if tracks and not any(track.noncombatants for track in tracks):
        return None
    return CommandUnit(_look(stands, place), ahead=not tracks)


def _look(stands: StandingAssets, place: str) -> tuple[CommandSlot, ...]:
    """Return the command for a drone to observe a place."""
    return (CommandSlot(stands.near(place, "uav"), f"observe {place}"),)


def _robots(stands: StandingAssets, ask: Ask) -> tuple[str, ...]:
    """Return the candidate robots for an encounter: those named in `ask`, or else any."""
    return tuple(stands.fit(ask)) or stands.near(ask.place, "robot")


def units(stands: StandingAssets, ask: Ask) -> list[CommandUnit]:
    """Return the commands that serve `ask`; empty if no asset has to act or no asset can.

    Raises NotInPictureError if the console cannot determine them.
    """
    serving = list(_SERVES[ask.task](stands, ask))
    if not all(slot.agents for unit in serving for slot in unit.slots):
        return []
    return serving


def _sent(stands: StandingAssets, ask: Ask, command: str, place: str) -> Iterator[CommandUnit]:
    """Yield `command` for the named assets, or for the requested number of available ones.

    Named assets share one unit. A named asset that is the only guard of a gate has its own unit,
    because it may have to stay.
    """
    team = ask.who
    if team.names:
        away = [n for n in stands.fit(ask) if ask.task == "home" or stands.post(n) != place]
        yield from one_unit(CommandSlot((n,), command) for n in away if n not in stands.alone)
        yield from units_of_one(CommandSlot((n,), command) for n in away if n in stands.alone)
        return
    free = [
        name
        for name in stands.free(team.kind)
        if stands.post(name) != place and is_of(stands, name, ask)
    ]
    number = len(free) if team.count == "all" or ask.task == "mass" else team.count
    if number >= len(free):
        yield from units_of_one(
            CommandSlot((name,), command) for name in but_guards(stands, free, place)
        )
    else:
        yield from units_of_one(CommandSlot(tuple(free), command) for _ in range(number))


def _gone(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    yield from _sent(stands, ask, f"move_to {ask.place}", ask.place)


def _home(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    yield from _sent(stands, ask, "return_to_base", stands.world.base)


def _looked(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    if ask.who.names:
        yield from one_unit(
            CommandSlot((name,), f"observe {ask.place}") for name in stands.fit(ask)
        )
        return
    near = (n for n in stands.near(ask.place, "uav") if is_of(stands, n, ask))
    if drones := tuple(n for n in near if not unfit(n, ask, stands.world, stands.before)):
        yield CommandUnit((CommandSlot(drones, f"observe {ask.place}"),))


def _taken_over(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    """Yield the commands of a takeover: to the asset that leaves, and to those that arrive."""
    place = ask.place or (stands.post(ask.leaving) if ask.leaving else "")
    leaves: tuple[CommandSlot, ...] = ()
    if ask.task == "relieve" and stands.before.assets[ask.leaving].available:
        leaves = (CommandSlot((ask.leaving,), "return_to_base"),)
    if ask.who.names:
        away = (name for name in stands.fit(ask) if stands.post(name) != place)
        come = tuple(CommandSlot((name,), f"move_to {place}") for name in away)
    else:
        others = tuple(_guards(stands, ask, place))
        stays = ask.task == "relieve" and not others and _stand_there(stands, ask, place)
        come = () if stays else (CommandSlot(others, f"move_to {place}"),)
    yield from one_unit((*leaves, *come))


def _guards(stands: StandingAssets, ask: Ask, place: str) -> list[str]:
    """Return the assets that could guard a place, those of the requested kind first."""
    kind, assets = ask.who.kind, stands.before.assets
    free = [n for n in stands.free() if is_of(stands, n, ask) and stands.post(n) != place]
    if not any(kind in (None, stands.kind(name)) for name in free):
        free = [] if _stand_there(stands, ask, place) else free
    return sorted(free, key=lambda n: (assets[n].comms != "ok", kind not in (None, stands.kind(n))))


def _stand_there(stands: StandingAssets, ask: Ask, place: str) -> bool:
    """Return whether a free asset that could guard `place` is already at it."""
    free = (name for name in stands.free(ask.who.kind) if is_of(stands, name, ask))
    return any(stands.post(name) == place for name in free)


def _swapped(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    first, second = ask.who.names
    places = ((first, second), (second, first))
    yield CommandUnit(
        tuple(CommandSlot((asset,), f"move_to {stands.post(other)}") for asset, other in places)
    )


def _stood_down(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    """Yield commands that send all but one asset of a place home, those with low battery first."""
    assets = stands.before.assets
    there = [n for n, a in assets.items() if a.available and a.post == ask.place]
    stays = sorted(there, key=lambda n: assets[n].low_battery)[:1]
    leave = [name for name in there if name not in (*stays, *stands.named)]
    yield from one_unit(CommandSlot((name,), "return_to_base") for name in leave)


def _reported(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    team = ask.who
    if team.names:
        yield from units_of_one(CommandSlot((name,), "report") for name in stands.fit(ask))
        return
    candidates = tuple(n for n in reporters(ask, stands.before) if n not in stands.named)
    number = team.count
    if number != "all" and not of_everyone(ask):
        yield from units_of_one(
            CommandSlot(candidates, "report") for _ in range(min(number, len(candidates)))
        )


def _held(stands: StandingAssets, ask: Ask) -> Iterator[CommandUnit]:
    yield from units_of_one(CommandSlot((name,), "hold") for name in stands.fit(ask))


def _not_in_picture(_stands: StandingAssets, _ask: Ask) -> Iterator[CommandUnit]:
    raise NotInPictureError


_SERVES: Mapping[Task, Callable[[StandingAssets, Ask], Iterator[CommandUnit]]] = {
    "go": _gone,
    "mass": _gone,
    "home": _home,
    "look": _looked,
    "identify": identify_units,
    "warn": encounter_units,
    "respond": encounter_units,
    "block": block_units,
    "cover": _taken_over,
    "relieve": _taken_over,
    "swap": _swapped,
    "stand_down": _stood_down,
    "report": _reported,
    "hold": _held,
    "refused": _not_in_picture,
    "unreadable": _not_in_picture,
}


def commands_serving(
    reading: Reading, world: World, picture: Picture
) -> Iterator[tuple[CommandSlot, ...]]:
    """Yield the commands of plans for `reading`, each with its candidate agents; best plan first.

    The first plans do everything that can be done; later ones drop some of it: first observations
    of places without a known contact, then the tasks that were asked last. For each of these parts,
    the plan whose agents the model chooses comes before the one with the console's choice. In a
    plan, commands that cover a gate come first (WF-03). The last plan is a hold. Nothing is yielded
    if the console cannot determine the commands.
    """
    reading = within_capability(reading, world)
    named = (n for ask in reading.asks for n in (*ask.who.names, ask.leaving) if n)
    stands = StandingAssets(world, picture, _NOTHING, frozenset((*named, *reading.excluded)))
    due = [ask for ask in reading.asks if not obstacle_to(ask, world, picture)]
    try:
        all_units = [unit for ask in due for unit in units(stands, ask)]
    except NotInPictureError:
        return
    called = [name for ask in due if of_everyone(ask) for name in reporters(ask, picture)]
    for part in _parts(all_units[:MAX_ACTIONS]) if all_units or called else []:
        slots = [slot for unit in part for slot in unit.slots]
        for late in (False, True):
            ways = _ways(stands, slots, called, others_stay=reading.others_stay, late=late)
            if looked_at := list(islice(ways, _WAYS)):
                looked_at.sort(key=lambda way: _late_s(stands, way))
                yield from _chosen(looked_at)
                break
    yield (CommandSlot(tuple(name for name, a in picture.assets.items() if a.available), "hold"),)


def _parts(all_units: Sequence[CommandUnit]) -> list[list[CommandUnit]]:
    """Return the selections of `all_units` that are tried: all units, then fewer and fewer."""
    number = len(all_units)
    left_out = (
        sorted(
            combinations(range(number), count),
            key=lambda out: (sum(not all_units[i].ahead for i in out), [-i for i in reversed(out)]),
        )
        for count in range(max(number, 1))
    )
    every = (out for some in left_out for out in some)
    return [
        [unit for i, unit in enumerate(all_units) if i not in out] for out in islice(every, _PARTS)
    ]


def _chosen(ways: Sequence[Way]) -> Iterator[tuple[CommandSlot, ...]]:
    """Yield the commands of the first of `ways`: with all candidates, then with its own agents."""
    first = ways[0]
    commands = [action.command for action in first]
    alike = [way for way in ways if [action.command for action in way] == commands]
    names = (dict.fromkeys(way[i].agent for way in alike) for i in range(len(first)))
    yield tuple(CommandSlot(tuple(n), command) for n, command in zip(names, commands, strict=True))
    if len(alike) > 1:
        yield tuple(CommandSlot((action.agent,), action.command) for action in first)


def _ways(
    stands: StandingAssets,
    slots: Sequence[CommandSlot],
    called: Sequence[str],
    *,
    others_stay: bool,
    late: bool,
) -> Iterator[Way]:
    """Yield plans in which each asset has at most one command and no gate stays uncovered.

    The assets in `called` report if they have no other command. With `late`, gates may wait for
    their new guard.
    """
    for assigned in islice(_assignments(slots), _TRIED):
        goals = _goals(stands, assigned)
        for more in backfill_commands(stands, goals, others_stay=others_stay, late=late):
            first = [Action(agent=name, command=command) for name, command in more]
            busy = {*goals, *(name for name, _ in more)}
            reports = (Action(agent=n, command="report") for n in called if n not in busy)
            if way := (*first, *assigned, *reports)[:MAX_ACTIONS]:
                yield way


def _goals(stands: StandingAssets, actions: Sequence[Action]) -> dict[str, str]:
    """Return the place of each agent after its command."""
    ends = ((action.agent, goes_to(action, stands.world)) for action in actions)
    return {name: goal or stands.post(name) for name, goal in ends}


def _late_s(stands: StandingAssets, way: Way) -> float:
    """Return the total time that gates wait for a new guard, in seconds."""
    return bare_s(stands, _goals(stands, way))


def _assignments(
    slots: Sequence[CommandSlot], had: tuple[Action, ...] = ()
) -> Iterator[tuple[Action, ...]]:
    """Yield the assignments of `slots` to distinct assets that begin with the actions in `had`."""
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
            yield from _assignments(slots, (*had, Action(agent=name, command=command)))
