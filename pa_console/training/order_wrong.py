"""Draws asks that must not be carried out, or cannot be."""

from collections.abc import Callable, Mapping

from pa_console.schema.world import AssetKind
from pa_console.training.order import Ask, Task, Who, Wrong
from pa_console.training.order_asks import draw_ask
from pa_console.training.order_view import View

FORBIDDEN: tuple[Wrong, ...] = (
    "force", "skip_identification", "skip_warning", "override", "chase", "zone", "noncombatants",
    "strip",
)  # fmt: skip
IMPOSSIBLE: tuple[Wrong, ...] = (
    "unknown_place", "unknown_asset", "down", "incapable", "none_left",
)  # fmt: skip
_INCAPABLE: tuple[tuple[AssetKind, Task], ...] = (
    ("uav", "warn"), ("uav", "block"), ("uav", "identify"), ("robot", "look"), ("ugv", "look"),
    ("robot", "block"), ("ugv", "warn"),
)  # fmt: skip
_PLAIN: tuple[Task, ...] = ("go", "look", "identify", "block", "home", "respond", "cover")


def draw_wrong(wrong: Wrong, view: View) -> Ask | None:
    """Return an ask that is wrong in this way, None when the situation does not have it."""
    ask = _DRAW[wrong](view)
    return None if ask is None else ask.model_copy(update={"wrong": wrong})


def _meeting(task: Task, kind: AssetKind) -> Callable[[View], Ask | None]:
    """Return what draws an encounter, with somebody or nobody named."""

    def draw(view: View) -> Ask | None:
        return Ask(
            task=task,
            who=_anyone(view, kind),
            place=view.visited(0.75),
            track="vehicle" if view.chance(0.7) else "person",
        )

    return draw


def _skip_identification(view: View) -> Ask | None:
    return _meeting("block", "ugv")(view) if view.chance(0.5) else _meeting("warn", "robot")(view)


def _noncombatants(view: View) -> Ask | None:
    task: Task = view.weighted({"identify": 1.0, "warn": 1.0, "block": 1.0})
    return _meeting(task, "ugv" if task == "block" else "robot")(view)


def _override(view: View) -> Ask | None:
    return draw_ask(view.rng.choice(_PLAIN), view)


def _chase(view: View) -> Ask | None:
    kind: AssetKind = view.weighted({"uav": 3.0, "ugv": 1.0, "robot": 1.0})
    track = "vehicle" if view.chance(0.7) else "person"
    return Ask(task="respond", who=_anyone(view, kind), place=view.visited(0.75), track=track)


def _zone(view: View) -> Ask | None:
    zone = view.some(list(view.world.zones))
    if zone is None or any(t.intent == "hostile" for t in view.picture.tracks.values()):
        return None
    return Ask(task="go", who=_somebody(view), place=zone)


def _strip(view: View) -> Ask | None:
    if view.chance(0.3):
        return Ask(task="home", who=Who(count="all"))
    guarded = [gate for gate, count in view.digest.covered.items() if count]
    gate = view.some(guarded)
    return Ask(task="home", who=Who(count="all"), place=gate) if gate else None


def _unknown_place(view: View) -> Ask | None:
    return Ask(task="go", who=_somebody(view))


def _unknown_asset(view: View) -> Ask | None:
    """Return an order to an asset whose number goes on from those of its kind."""
    like = view.rng.choice(list(view.world.assets))
    stem = like.rstrip("0123456789")
    digits = len(like) - len(stem)
    if not digits:
        return None
    free = [
        name
        for number in range(1, 10**digits)
        if (name := f"{stem}{number:0{digits}d}") not in view.world.assets
    ]
    name = view.some(free[:12])
    if name is None:
        return None
    task: Task = view.weighted({"go": 4.0, "home": 1.0, "report": 1.0, "hold": 0.5})
    place = view.place() if task == "go" else ""
    return Ask(task=task, who=Who(names=(name,)), place=place)


def _down(view: View) -> Ask | None:
    names = view.names(view.down, most=1)
    if not names:
        return None
    task: Task = view.weighted({"go": 4.0, "home": 1.0, "report": 1.0})
    place = view.place() if task == "go" else ""
    return Ask(task=task, who=Who(names=names), place=place)


def _incapable(view: View) -> Ask | None:
    kind, task = view.rng.choice(_INCAPABLE)
    pool = [n for n in view.up if view.world.assets[n].kind == kind]
    who = Who(names=view.names(pool, most=1)) if pool and view.chance(0.6) else Who(kind=kind)
    return Ask(task=task, who=who, place=view.visited(0.6))


def _none_left(view: View) -> Ask | None:
    kinds: tuple[AssetKind, ...] = ("uav", "ugv", "robot")
    gone: list[AssetKind] = [kind for kind in kinds if not view.digest.free[kind]]
    kind = view.some(gone)
    if kind is None:
        return None
    return Ask(task="go", who=Who(kind=kind), place=view.gate(lambda g: _without(view, g, kind)))


def _without(view: View, gate: str, kind: AssetKind) -> bool:
    return all(view.world.assets[n].kind != kind for n in view.picture.gates[gate].by)


def _anyone(view: View, kind: AssetKind) -> Who:
    """Return nobody, a kind, or one that is up."""
    drawn = view.rng.random()
    pool = [n for n in view.up if view.world.assets[n].kind == kind]
    if drawn < 0.35 and pool:
        return Who(names=view.names(pool, most=1))
    return Who(kind=kind) if drawn < 0.6 else Who()


def _somebody(view: View) -> Who:
    """Return one that is up, or a kind."""
    kind: AssetKind = view.weighted({"uav": 3.0, "ugv": 1.0, "robot": 1.0})
    if view.up and view.chance(0.5):
        return Who(names=view.names(view.up, most=1))
    return Who(kind=kind)


_DRAW: Mapping[Wrong, Callable[[View], Ask | None]] = {
    "force": _meeting("block", "ugv"),
    "skip_identification": _skip_identification,
    "skip_warning": _meeting("block", "ugv"),
    "override": _override,
    "chase": _chase,
    "zone": _zone,
    "noncombatants": _noncombatants,
    "strip": _strip,
    "unknown_place": _unknown_place,
    "unknown_asset": _unknown_asset,
    "down": _down,
    "incapable": _incapable,
    "none_left": _none_left,
}
