"""What of an order cannot be carried out, or must not be: read from the picture, not from words."""

from collections.abc import Mapping

from pa_console.llm.facts import WORDS
from pa_console.llm.reading import Wish, WishTask
from pa_console.schema.plan import COMMANDS, Verb
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import AssetKind, World

VERBS: Mapping[WishTask, Verb] = {
    "look": "observe", "identify": "identify", "warn": "warn", "block": "block",
}  # fmt: skip
"""The command that a task is carried out with, where only some kinds of assets have it."""
_PLACED: frozenset[WishTask] = frozenset(("go", "look", "identify", "warn", "block", "mass"))


def hindrance(wish: Wish, world: World, picture: Picture) -> str:
    """Return why nothing of `wish` can be done, empty when at least a part can."""
    if wish.task == "refused":
        return "no order may have that"
    if wish.place in world.zones:
        return f"{wish.place} is closed (ROE-07)"
    if wish.place not in world.frames and (wish.place or wish.task in _PLACED):
        return "no such place (CAP-06)"
    if wish.leaving and wish.leaving not in world.assets:
        return f"no asset {wish.leaving} (CAP-10)"
    names, kind = wish.team.names, wish.team.kind
    problems = [why for name in names if (why := unfit(name, wish, world, picture))]
    if problems and (len(problems) == len(names) or wish.task == "swap"):
        return problems[0]
    if names:
        return ""
    return (_incapable(kind, wish.task) if kind is not None else "") or _nobody(wish, picture)


def unfit(name: str, wish: Wish, world: World, picture: Picture) -> str:
    """Return why the asset of that name cannot do its part of `wish`, empty when it can."""
    asset = picture.assets.get(name)
    if asset is None:
        return f"no asset {name} (CAP-10)"
    if not asset.available:
        return f"{name} is down"
    stays = wish.task in ("home", "report", "hold") or wish.place == world.base
    if asset.low_battery and not stays:
        return f"{name} is low (CAP-04)"
    if wish.task in VERBS and asset.comms != "ok":
        return f"{name} has a poor link (CAP-05)"
    return _incapable(asset.kind, wish.task)


def _nobody(wish: Wish, picture: Picture) -> str:
    """Return that every asset which could do it is down."""
    kind, verb = wish.team.kind, VERBS.get(wish.task)
    kinds = (kind,) if kind is not None else COMMANDS[verb].kinds if verb is not None else ()
    up = {asset.kind for asset in picture.assets.values() if asset.available}
    return "" if not kinds or up.intersection(kinds) else "whoever could do it is down (CAP-10)"


def can_have(kind: AssetKind, task: WishTask) -> bool:
    """Whether assets of a kind have the command that a task is carried out with."""
    verb = VERBS.get(task)
    return verb is None or kind in COMMANDS[verb].kinds


def _incapable(kind: AssetKind, task: WishTask) -> str:
    return "" if can_have(kind, task) else f"no {WORDS[kind]} can {VERBS[task]}"
