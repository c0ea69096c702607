"""Which commands serve what was understood of an order, each with the assets that could have it.

It is the other side of `fulfilment.py`: there a plan is compared with what was asked, here the
console says what a plan for it is made of. Who of those that could go does go is left to the model.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

from pa_console.llm.reading import Reading, Wish, WishTask
from pa_console.llm.slot_grammar import Slot
from pa_console.orchestrator.hindrance import hindrance, unfit
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.orchestrator.reporters import beside, of_everyone, reporters
from pa_console.policy.context import goes_to
from pa_console.schema.plan import MAX_ACTIONS, Action, Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import AssetKind, World

_NOTHING = Plan(reason="nothing yet", actions=())


class _UntoldError(Exception):
    """What serves a wish depends on more than the picture tells."""


def serving_slots(reading: Reading, world: World, picture: Picture) -> tuple[Slot, ...]:
    """Return the commands of a plan that serves `reading`, those that cover a gate first (WF-03).

    Where nothing of it can be done, somebody holds. It is empty where the console cannot tell: a
    workflow has to go on at a gate, or there are more wishes than assets.
    """
    stands = PlanMoves(world, picture, _NOTHING)
    due = [wish for wish in reading.wishes if not hindrance(wish, world, picture)]
    try:
        asked = [slot for wish in due for slot in _SERVES[wish.task](stands, wish)]
        slots = [*_backfills(stands, asked, reading.others_stay), *asked]
        called = (reporters(wish, picture) for wish in due if of_everyone(wish))
        slots += beside(slots, list(dict.fromkeys(name for names in called for name in names)))
    except _UntoldError:
        return ()
    if not slots:
        slots = [Slot(tuple(n for n, asset in picture.assets.items() if asset.available), "hold")]
    return _apart(slots)


def _apart(slots: Sequence[Slot]) -> tuple[Slot, ...]:
    """Return `slots` in which nobody who has one command alone is thought of for another.

    It is empty where there are more commands than assets for them.
    """
    fixed = [slot.agents[0] for slot in slots if len(slot.agents) == 1]
    free = [
        slot
        if len(slot.agents) == 1
        else Slot(tuple(name for name in slot.agents if name not in fixed), slot.command)
        for slot in slots
    ]
    every = {name for slot in free for name in slot.agents}
    doubled = len({*fixed}) < len(fixed) or not all(slot.agents for slot in free)
    return () if doubled or len(slots) > min(len(every), MAX_ACTIONS) else tuple(free)


def _backfills(stands: PlanMoves, asked: Sequence[Slot], others_stay: bool) -> Iterator[Slot]:
    """Yield who takes over each gate that all its guards would leave too long (WF-03).

    Who is sent there anyway takes over, unless that is later than the gate's grace.
    """
    ways = [(s, goes_to(Action(agent=s.agents[0], command=s.command), stands.world)) for s in asked]
    leaving = {slot.agents[0]: goal for slot, goal in ways if len(slot.agents) == 1 and goal}
    free = [name for name in stands.free() if name not in leaving]
    for gate in stands.world.gates:
        guards, others = stands.guards(gate), free
        if coming := [name for slot, goal in ways if goal == gate for name in slot.agents]:
            others = [name for name in free if _is_in_time(stands, name, gate)]
        stays = any(leaving.get(name, gate) == gate for name in guards)
        if not guards or stays or any(_is_in_time(stands, name, gate) for name in coming):
            continue
        if others or not coming:
            if others_stay:
                raise _UntoldError
            yield Slot(_in_time(stands, _among(stands, others), gate), f"move_to {gate}")


def _in_time(stands: PlanMoves, names: Sequence[str], gate: str) -> tuple[str, ...]:
    """Return those of `names` who can be at `gate` before its grace is over, or the two soonest."""
    soonest = sorted(names, key=lambda name: _way_s(stands, name, gate))[:2]
    return tuple(n for n in names if n in soonest or _is_in_time(stands, n, gate))


def _is_in_time(stands: PlanMoves, name: str, gate: str) -> bool:
    return _way_s(stands, name, gate) <= stands.world.coverage_grace_s


def _way_s(stands: PlanMoves, name: str, gate: str) -> float:
    """Return how long an asset needs at least to be at a gate, in seconds."""
    way = math.dist(stands.before.assets[name].position, stands.world.frames[gate].at)
    return way / stands.world.platforms[stands.kind(name)].speed_mps


def _among(stands: PlanMoves, names: Sequence[str], elsewhere: str = "") -> tuple[str, ...]:
    """Return those of `names` who do not stand `elsewhere`; raises _UntoldError for nobody."""
    found = tuple(name for name in names if not elsewhere or stands.post(name) != elsewhere)
    if not found:
        raise _UntoldError
    return found


def _sent(stands: PlanMoves, wish: Wish, command: str, place: str) -> Iterator[Slot]:
    """Yield `command` for those named, or for as many as are asked for and to be had."""
    team = wish.team
    if team.names:
        away = (n for n in _fit(stands, wish) if wish.task == "home" or stands.post(n) != place)
        yield from (Slot((name,), command) for name in away)
        return
    free = [
        name
        for name in stands.free(team.kind)
        if stands.post(name) != place and team.origin in ("", stands.post(name))
    ]
    number = len(free) if team.number == "all" or wish.task == "mass" else team.number
    if number >= len(free):
        yield from (Slot((name,), command) for name in _but_guards(stands, free, place))
    else:
        yield from (Slot(tuple(free), command) for _ in range(number))


def _but_guards(stands: PlanMoves, names: Sequence[str], place: str) -> Iterator[str]:
    """Yield `names` without the last guard of each other gate, who stays (WF-03)."""
    left = {gate: [*stands.guards(gate)] for gate in stands.world.gates if gate != place}
    for name in names:
        gate = stands.post(name)
        if left.get(gate) != [name]:
            yield name
            if name in left.get(gate, ()):
                left[gate].remove(name)


def _fit(stands: PlanMoves, wish: Wish) -> list[str]:
    names = wish.team.names
    return [name for name in names if not unfit(name, wish, stands.world, stands.before)]


def _gone(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    yield from _sent(stands, wish, f"move_to {wish.place}", wish.place)


def _home(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    yield from _sent(stands, wish, "return_to_base", stands.world.base)


def _looked(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    if wish.team.names:
        yield from (Slot((name,), f"observe {wish.place}") for name in _fit(stands, wish))
    elif drones := _near(stands, wish.place, "uav"):
        yield Slot(drones, f"observe {wish.place}")


def _near(stands: PlanMoves, place: str, kind: AssetKind) -> tuple[str, ...]:
    """Return who of a kind stands at a place, then who is free."""
    return tuple(dict.fromkeys((*stands.there(place, kind), *stands.free(kind))))


def _identified(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    """Yield that a drone looks first where nobody has (WF-02), and who identifies who is there."""
    tracks = stands.tracks(wish.place)
    if not tracks or not all(track.observed for track in tracks):
        yield _seen(stands, wish.place)
    if tracks:
        robots = tuple(_fit(stands, wish)) or _near(stands, wish.place, "robot")
        yield Slot(robots, f"identify {wish.place}")


def _seen(stands: PlanMoves, place: str) -> Slot:
    """Return that a drone looks at a place; raises _UntoldError for nobody."""
    return Slot(_among(stands, _near(stands, place, "uav")), f"observe {place}")


def _met(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    """Yield that a drone looks where nobody is known to be; a track has to be met in order."""
    if stands.tracks(wish.place):
        raise _UntoldError
    yield _seen(stands, wish.place)


def _blocked(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    """Yield who closes a lane where nobody is who would have to be met first (WF-01)."""
    if stands.tracks(wish.place):
        raise _UntoldError
    if wish.team.names:
        yield from (Slot((name,), f"block {wish.place}") for name in _fit(stands, wish))
    elif vehicles := _near(stands, wish.place, "ugv"):
        yield Slot(vehicles, f"block {wish.place}")


def _taken_over(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    place = wish.place or (stands.post(wish.leaving) if wish.leaving else "")
    team = wish.team
    if wish.leaving and stands.before.assets[wish.leaving].available:
        yield Slot((wish.leaving,), "return_to_base")
    names = [name for name in _fit(stands, wish) if stands.post(name) != place]
    if team.names:
        yield from (Slot((name,), f"move_to {place}") for name in names)
    else:
        yield Slot(_among(stands, stands.free(team.kind), place), f"move_to {place}")


def _swapped(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    first, second = wish.team.names
    for one, other in ((first, second), (second, first)):
        yield Slot((one,), f"move_to {stands.post(other)}")


def _reported(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    team = wish.team
    if team.names:
        yield from (Slot((name,), "report") for name in _fit(stands, wish))
        return
    asked, number = reporters(wish, stands.before), team.number
    if number != "all" and not of_everyone(wish):
        yield from (Slot(asked, "report") for _ in range(min(number, len(asked))))


def _held(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    yield from (Slot((name,), "hold") for name in _fit(stands, wish))


def _untold(_stands: PlanMoves, _wish: Wish) -> Iterator[Slot]:
    raise _UntoldError


_SERVES: Mapping[WishTask, Callable[[PlanMoves, Wish], Iterator[Slot]]] = {
    "go": _gone,
    "mass": _gone,
    "home": _home,
    "look": _looked,
    "identify": _identified,
    "warn": _met,
    "respond": _met,
    "block": _blocked,
    "cover": _taken_over,
    "relieve": _taken_over,
    "swap": _swapped,
    "stand_down": _untold,
    "report": _reported,
    "hold": _held,
    "refused": _untold,
    "unreadable": _untold,
}
