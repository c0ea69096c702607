"""Which commands serve each wish of an order, each with the assets that could have it.

It is the other side of `fulfilment.py`: there a plan is compared with what was asked, here the
console says what a plan for it is made of.
"""

from collections.abc import Callable, Iterator, Mapping

from pa_console.llm.reading import Wish, WishTask
from pa_console.llm.slot_grammar import Slot
from pa_console.orchestrator.hindrance import unfit
from pa_console.orchestrator.reporters import of_everyone, reporters
from pa_console.orchestrator.serving_backfill import but_guards
from pa_console.orchestrator.serving_encounters import blocked, identified, met
from pa_console.orchestrator.serving_stands import Stands, Unit, UntoldError, each, together
from pa_console.orchestrator.wish_moves import is_of


def units(stands: Stands, wish: Wish) -> list[Unit]:
    """Return what serves `wish`, nothing where nobody is to do anything.

    Raises UntoldError where the console cannot tell.
    """
    found = list(_SERVES[wish.task](stands, wish))
    if not all(slot.agents for unit in found for slot in unit.slots):
        return []
    return found


def _sent(stands: Stands, wish: Wish, command: str, place: str) -> Iterator[Unit]:
    """Yield `command` for those named, or for as many as are asked for and to be had.

    Of those named, a gate may need each one that covers it alone.
    """
    team = wish.team
    if team.names:
        away = [n for n in stands.fit(wish) if wish.task == "home" or stands.post(n) != place]
        yield from together(Slot((n,), command) for n in away if n not in stands.alone)
        yield from each(Slot((n,), command) for n in away if n in stands.alone)
        return
    free = [
        name
        for name in stands.free(team.kind)
        if stands.post(name) != place and is_of(stands, name, wish)
    ]
    number = len(free) if team.number == "all" or wish.task == "mass" else team.number
    if number >= len(free):
        yield from each(Slot((name,), command) for name in but_guards(stands, free, place))
    else:
        yield from each(Slot(tuple(free), command) for _ in range(number))


def _gone(stands: Stands, wish: Wish) -> Iterator[Unit]:
    yield from _sent(stands, wish, f"move_to {wish.place}", wish.place)


def _home(stands: Stands, wish: Wish) -> Iterator[Unit]:
    yield from _sent(stands, wish, "return_to_base", stands.world.base)


def _looked(stands: Stands, wish: Wish) -> Iterator[Unit]:
    if wish.team.names:
        yield from together(Slot((name,), f"observe {wish.place}") for name in stands.fit(wish))
        return
    near = (n for n in stands.near(wish.place, "uav") if is_of(stands, n, wish))
    if drones := tuple(n for n in near if not unfit(n, wish, stands.world, stands.before)):
        yield Unit((Slot(drones, f"observe {wish.place}"),))


def _taken_over(stands: Stands, wish: Wish) -> Iterator[Unit]:
    """Yield who leaves and who comes; nobody comes where those who could stand there already."""
    place = wish.place or (stands.post(wish.leaving) if wish.leaving else "")
    leaves: tuple[Slot, ...] = ()
    if wish.task == "relieve" and stands.before.assets[wish.leaving].available:
        leaves = (Slot((wish.leaving,), "return_to_base"),)
    if wish.team.names:
        away = (name for name in stands.fit(wish) if stands.post(name) != place)
        come = tuple(Slot((name,), f"move_to {place}") for name in away)
    else:
        others = tuple(_guards(stands, wish, place))
        stays = wish.task == "relieve" and not others and _stand_there(stands, wish, place)
        come = () if stays else (Slot(others, f"move_to {place}"),)
    yield from together((*leaves, *come))


def _guards(stands: Stands, wish: Wish, place: str) -> list[str]:
    """Return who could come to guard a place: of the kind that is asked for first, then others."""
    kind, assets = wish.team.kind, stands.before.assets
    free = [n for n in stands.free() if is_of(stands, n, wish) and stands.post(n) != place]
    if not any(kind in (None, stands.kind(name)) for name in free):
        free = [] if _stand_there(stands, wish, place) else free
    return sorted(free, key=lambda n: (assets[n].comms != "ok", kind not in (None, stands.kind(n))))


def _stand_there(stands: Stands, wish: Wish, place: str) -> bool:
    """Whether somebody who could guard a place stands there and is free."""
    free = (name for name in stands.free(wish.team.kind) if is_of(stands, name, wish))
    return any(stands.post(name) == place for name in free)


def _swapped(stands: Stands, wish: Wish) -> Iterator[Unit]:
    first, second = wish.team.names
    places = ((first, second), (second, first))
    yield Unit(tuple(Slot((one,), f"move_to {stands.post(other)}") for one, other in places))


def _stood_down(stands: Stands, wish: Wish) -> Iterator[Unit]:
    """Yield that all but one of those at a place go home: who is low rather than who is not."""
    assets = stands.before.assets
    there = [n for n, a in assets.items() if a.available and a.post == wish.place]
    stays = sorted(there, key=lambda n: assets[n].low_battery)[:1]
    leave = [name for name in there if name not in (*stays, *stands.named)]
    yield from together(Slot((name,), "return_to_base") for name in leave)


def _reported(stands: Stands, wish: Wish) -> Iterator[Unit]:
    team = wish.team
    if team.names:
        yield from each(Slot((name,), "report") for name in stands.fit(wish))
        return
    asked = tuple(n for n in reporters(wish, stands.before) if n not in stands.named)
    number = team.number
    if number != "all" and not of_everyone(wish):
        yield from each(Slot(asked, "report") for _ in range(min(number, len(asked))))


def _held(stands: Stands, wish: Wish) -> Iterator[Unit]:
    yield from each(Slot((name,), "hold") for name in stands.fit(wish))


def _untold(_stands: Stands, _wish: Wish) -> Iterator[Unit]:
    raise UntoldError


_SERVES: Mapping[WishTask, Callable[[Stands, Wish], Iterator[Unit]]] = {
    "go": _gone,
    "mass": _gone,
    "home": _home,
    "look": _looked,
    "identify": identified,
    "warn": met,
    "respond": met,
    "block": blocked,
    "cover": _taken_over,
    "relieve": _taken_over,
    "swap": _swapped,
    "stand_down": _stood_down,
    "report": _reported,
    "hold": _held,
    "refused": _untold,
    "unreadable": _untold,
}
