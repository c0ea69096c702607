"""Draws one ask of a task: mostly it fits what the picture shows; some must not be carried out."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

from pa_console.language.canonical.order import KIND_FOR, Ask, Task, Who, Wrong
from pa_console.schema.world import AssetKind
from pa_training.order_generator.order_view import View

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
    ask = _WRONG_DRAW[wrong](view)
    return None if ask is None else replace(ask, wrong=wrong)


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


_WRONG_DRAW: Mapping[Wrong, Callable[[View], Ask | None]] = {
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


_ANY: tuple[AssetKind, ...] = ("uav", "ugv", "robot")


def draw_ask(task: Task, view: View) -> Ask | None:
    """Return an ask of `task`, None when the situation has nothing for it."""
    return _ASKS_DRAW[task](view)


def _go(view: View) -> Ask | None:
    place = view.place()
    if view.chance(0.5):
        pool = [n for n in view.up if view.stands(n) != place]
        free = [n for n in pool if n in view.free()]
        names = view.names(free if free and view.chance(0.7) else pool)
        if not names:
            return None
        strict = view.chance(0.08)
        return Ask(task="go", who=Who(names=names), place=place, strict_who=strict)
    kind = _some_kind(view)
    who = view.team(kind)
    if view.chance(0.06):
        who = Who(kind=kind, count="all")
    elif who.origin == place:
        who = replace(who, origin="")
    return Ask(task="go", who=who, place=place)


def _look(view: View) -> Ask | None:
    place = view.place(not_at=(view.world.base,))
    if any(t.gate == place for t in view.tracks) or not view.chance(0.5):
        place = view.visited(0.6)
    drawn = view.rng.random()
    track = _track_kind(view, place) if view.chance(0.5) else ""
    if drawn < 0.35:
        names = view.names([n for n in view.up if view.world.assets[n].kind == "uav"], most=2)
        return Ask(task="look", who=Who(names=names), place=place, track=track) if names else None
    if drawn < 0.7:
        return Ask(task="look", who=view.team("uav", most=2), place=place, track=track)
    return Ask(task="look", place=place, track=track)


def _meet(task: Task) -> Callable[[View], Ask | None]:
    """Return what draws an ask to identify, warn or block."""

    def draw(view: View) -> Ask | None:
        kind = KIND_FOR[task]
        place = view.visited(0.5 if task == "block" else 0.92)
        if not view.tracks and task != "block" and view.chance(0.8):
            return None
        track = _track_kind(view, place)
        track_id = _track_id(view, place) if view.chance(0.12) else ""
        drawn = view.rng.random()
        who = Who()
        if drawn < 0.4:
            pool = [n for n in view.up if view.world.assets[n].kind == kind]
            who = Who(names=view.names(pool, most=1))
            if not who.names:
                return None
        elif drawn < 0.75:
            who = Who(kind=kind)
        return Ask(task=task, who=who, place=place, track=track, track_id=track_id)

    return draw


def _respond(view: View) -> Ask | None:
    place = view.visited(0.93)
    if not view.tracks and view.chance(0.7):
        return None
    track_id = _track_id(view, place) if view.chance(0.15) else ""
    track = _track_kind(view, place) or ("vehicle" if view.chance(0.75) else "person")
    return Ask(task="respond", place=place, track=track, track_id=track_id)


def _cover(view: View) -> Ask | None:
    bare = list(view.digest.uncovered)
    lost = [n for n in view.down if view.picture.assets[n].post in view.world.gates]
    who = Who(kind=_some_kind(view)) if view.chance(0.3) else Who()
    if lost and view.chance(0.6):
        name = view.rng.choice(lost)
        view.named.add(name)
        place = view.picture.assets[name].post or ""
        return Ask(task="cover", who=who, place=place, leaving=name)
    if bare and view.chance(0.9):
        return Ask(task="cover", who=who, place=view.rng.choice(bare))
    if view.alone and view.chance(0.3):
        name = view.rng.choice(view.alone)
        view.named.add(name)
        return Ask(task="cover", who=who, place=view.stands(name), leaving=name)
    return Ask(task="cover", who=who, place=view.gate()) if view.chance(0.25) else None


def _relieve(view: View) -> Ask | None:
    guards = [n for n in view.up if view.stands(n) in view.world.gates]
    low = [n for n in guards if n in view.low]
    leaving = view.some(low if low and view.chance(0.8) else guards)
    if leaving is None:
        return None
    view.named.add(leaving)
    who = Who()
    drawn = view.rng.random()
    pool = [n for n in view.free() if view.stands(n) != view.stands(leaving)]
    if drawn < 0.35 and pool:
        who = Who(names=view.names(pool, most=1))
    elif drawn < 0.55:
        who = Who(kind=_some_kind(view))
    return Ask(task="relieve", who=who, leaving=leaving, place=view.stands(leaving))


def _swap(view: View) -> Ask | None:
    first = view.some([n for n in view.up if view.stands(n) and n not in view.low])
    if first is None:
        return None
    pool = [
        n for n in view.up if view.stands(n) not in ("", view.stands(first)) and n not in view.low
    ]
    alike = [n for n in pool if view.world.assets[n].kind == view.world.assets[first].kind]
    second = view.some(alike if alike and view.chance(0.7) else pool)
    if second is None:
        return None
    view.named.update((first, second))
    return Ask(task="swap", who=Who(names=(first, second)))


def _home(view: View) -> Ask | None:
    away = [n for n in view.up if view.stands(n) != view.world.base]
    low = [n for n in away if n in view.low]
    if low and view.chance(0.7):
        return Ask(task="home", who=Who(names=view.names(low, most=1)))
    if view.chance(0.25):
        kind = _some_kind(view)
        who = view.team(kind, most=2)
        if who.origin == view.world.base:
            who = Who(kind=kind)
        return Ask(task="home", who=who)
    names = view.names(away, most=2)
    return Ask(task="home", who=Who(names=names)) if names else None


def _stand_down(view: View) -> Ask | None:
    def reinforced(gate: str) -> bool:
        return view.digest.covered.get(gate, 0) > 1

    gate = view.gate(reinforced)
    if not reinforced(gate) and not view.chance(0.15):
        return None
    return Ask(task="stand_down", place=gate)


def _mass(view: View) -> Ask | None:
    kind = _some_kind(view) if view.chance(0.5) else None
    return Ask(task="mass", who=Who(kind=kind, count="all"), place=view.visited(0.5))


def _report(view: View) -> Ask | None:
    drawn = view.rng.random()
    if drawn < 0.4:
        names = view.names(view.up)
        return Ask(task="report", who=Who(names=names)) if names else None
    if drawn < 0.55:
        return Ask(task="report", place=view.gate(lambda g: view.digest.covered.get(g, 0) > 0))
    if drawn < 0.7:
        kind = _some_kind(view)
        return Ask(task="report", who=Who(kind=kind, count="all" if view.chance(0.5) else 1))
    if drawn < 0.85:
        return Ask(task="report", who=Who(count="all"))
    return Ask(task="report")


def _hold(view: View) -> Ask | None:
    drawn = view.rng.random()
    if drawn < 0.6:
        names = view.names(view.up)
        return Ask(task="hold", who=Who(names=names)) if names else None
    return Ask(task="hold", who=Who(count="all") if drawn < 0.8 else Who())


def _some_kind(view: View) -> AssetKind:
    """Return a kind, one of which some asset is free more often than not."""
    free: list[AssetKind] = [kind for kind in _ANY if view.free(kind)]
    kinds: list[AssetKind] = free if free and view.chance(0.95) else list(_ANY)
    return view.rng.choices(kinds, [4.0 if kind == "uav" else 1.6 for kind in kinds])[0]


def _track_kind(view: View, place: str) -> Literal["vehicle", "person", ""]:
    """Return what kind of track is at the place, '' for none."""
    track = next((t for t in view.tracks if t.gate == place), None)
    return track.kind if track is not None else ""


def _track_id(view: View, place: str) -> str:
    return next((t.id for t in view.tracks if t.gate == place), "")


_ASKS_DRAW: Mapping[Task, Callable[[View], Ask | None]] = {
    "go": _go,
    "look": _look,
    "identify": _meet("identify"),
    "warn": _meet("warn"),
    "block": _meet("block"),
    "respond": _respond,
    "cover": _cover,
    "relieve": _relieve,
    "swap": _swap,
    "home": _home,
    "stand_down": _stand_down,
    "mass": _mass,
    "report": _report,
    "hold": _hold,
}
