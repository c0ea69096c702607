"""Which commands serve what was understood of an order, each with the assets that could have it.

It is the other side of `fulfilment.py`: there a plan is compared with what was asked, here the
console says what a plan for it is made of. Who of those that could go does go is left to the model.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

from pa_console.llm.reading import Reading, Wish, WishTask
from pa_console.llm.slot_grammar import Slot
from pa_console.orchestrator.hindrance import hindrance, unfit
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.orchestrator.reporters import beside, of_everyone, reporters
from pa_console.orchestrator.serving_backfill import UntoldError, among, backfills, but_guards
from pa_console.orchestrator.wish_moves import is_of
from pa_console.schema.plan import MAX_ACTIONS, Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import AssetKind, World

_LOOKED_AHEAD: frozenset[WishTask] = frozenset(("identify", "warn", "respond"))
"""What is served with a look where nobody is known to be; orders outright come before that."""
_NOTHING = Plan(reason="nothing yet", actions=())


def serving_slots(reading: Reading, world: World, picture: Picture) -> tuple[Slot, ...]:
    """Return the commands of a plan that serves `reading`, those that cover a gate first (WF-03).

    Where nothing of it can be done, somebody holds. Where it takes more than there are, nobody
    looks ahead. It is empty where the console cannot tell: a workflow has to go on at a gate, or
    there are more wishes than assets.
    """
    stands = PlanMoves(world, picture, _NOTHING)
    due = [wish for wish in reading.wishes if not hindrance(wish, world, picture)]
    outright = [w for w in due if w.task not in _LOOKED_AHEAD or stands.tracks(w.place)]
    try:
        found = _slots(stands, due, reading.others_stay)
        if not found and outright:
            found = _slots(stands, outright, reading.others_stay)
    except UntoldError:
        return ()
    return found


def _slots(stands: PlanMoves, due: Sequence[Wish], others_stay: bool) -> tuple[Slot, ...]:
    """Return the commands that serve the wishes that are `due`, empty for too few assets."""
    picture = stands.before
    asked = [slot for wish in due for slot in _SERVES[wish.task](stands, wish)]
    slots = [*backfills(stands, asked, others_stay), *asked]
    called = (reporters(wish, picture) for wish in due if of_everyone(wish))
    slots += beside(slots, list(dict.fromkeys(name for names in called for name in names)))
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
        if stands.post(name) != place and is_of(stands, name, wish)
    ]
    number = len(free) if team.number == "all" or wish.task == "mass" else team.number
    if number >= len(free):
        yield from (Slot((name,), command) for name in but_guards(stands, free, place))
    else:
        yield from (Slot(tuple(free), command) for _ in range(number))


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
    else:
        near = (n for n in _near(stands, wish.place, "uav") if is_of(stands, n, wish))
        if drones := tuple(n for n in near if not unfit(n, wish, stands.world, stands.before)):
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
    """Return that a drone looks at a place; raises UntoldError for nobody."""
    return Slot(among(stands, _near(stands, place, "uav")), f"observe {place}")


def _met(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    """Yield that a drone looks where nobody is known to be; a track has to be met in order."""
    if stands.tracks(wish.place):
        raise UntoldError
    yield _seen(stands, wish.place)


def _blocked(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    """Yield who closes a lane where nobody is who would have to be met first (WF-01)."""
    if stands.tracks(wish.place):
        raise UntoldError
    if wish.team.names:
        yield from (Slot((name,), f"block {wish.place}") for name in _fit(stands, wish))
    elif vehicles := _near(stands, wish.place, "ugv"):
        yield Slot(vehicles, f"block {wish.place}")


def _taken_over(stands: PlanMoves, wish: Wish) -> Iterator[Slot]:
    """Yield who leaves and who comes; nobody comes where those who could stand there already."""
    place = wish.place or (stands.post(wish.leaving) if wish.leaving else "")
    team = wish.team
    if wish.leaving and stands.before.assets[wish.leaving].available:
        yield Slot((wish.leaving,), "return_to_base")
    names = [name for name in _fit(stands, wish) if stands.post(name) != place]
    if team.names:
        yield from (Slot((name,), f"move_to {place}") for name in names)
        return
    free = [n for n in stands.free(team.kind) if n != wish.leaving and is_of(stands, n, wish)]
    if wish.task == "cover" or not free or any(stands.post(name) != place for name in free):
        yield Slot(among(stands, free, place), f"move_to {place}")


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
    raise UntoldError


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
