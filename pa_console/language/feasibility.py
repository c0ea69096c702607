"""The feasibility of an ask by places, names, kinds and states.

The console uses it for readings, and the teacher for drawn orders; each has its own words for it.
Whether a gate can spare its guard is not decided here.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Literal, NamedTuple

from pa_console.language.order import TASK_OF, Ask, Task
from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import KINDS, AssetKind, World

VERB_FOR: Mapping[Task, Verb] = {
    TASK_OF[verb]: verb for verb, spec in COMMANDS.items() if len(spec.kinds) < len(KINDS)
}
"""The command that a task is carried out with, where only some kinds of assets have it."""
KIND_FOR: Mapping[Task, AssetKind] = {
    task: kind for task, verb in VERB_FOR.items() for kind in COMMANDS[verb].kinds
}
"""The kind of assets that alone can do a task."""
PLACED: frozenset[Task] = frozenset(("go", "look", "identify", "warn", "block", "mass"))
"""The tasks that need a place."""


class Obstacle(NamedTuple):
    """The reason why an ask cannot be carried out, with its place, asset or kind."""

    problem: Literal["closed", "no place", "no asset", "down", "low", "poor link", "wrong kind"]
    subject: str = ""
    kind: AssetKind | None = None
    """The kind that has not the command; only of the wrong kind."""


Find = Callable[[str], Obstacle | None]
"""Returns the fault of an asset by name."""


def obstacle(ask: Ask, world: World, find: Find) -> Obstacle | None:
    """Return why nothing of `ask` can be done, None when at least a part can.

    Of those named, `find` returns what keeps one from its part.
    """
    if ask.place in world.zones:
        return Obstacle("closed", ask.place)
    if ask.place not in world.frames and (ask.place or ask.task in PLACED):
        return Obstacle("no place", ask.place)
    if ask.leaving and ask.leaving not in world.assets:
        return Obstacle("no asset", ask.leaving)
    names, kind = ask.who.names, ask.who.kind
    problems = [found for name in names if (found := find(name)) is not None]
    all_or_none = ask.strict_who or ask.task == "swap"
    if problems and (all_or_none or len(problems) == len(names)):
        return problems[0]
    if not names and kind is not None and not can_do(kind, ask.task):
        return Obstacle("wrong kind", kind=kind)
    return None


def asset_obstacles(name: str, ask: Ask, world: World, picture: Picture) -> Iterator[Obstacle]:
    """Yield everything that keeps the asset of that name from its part of `ask`."""
    asset = picture.assets.get(name)
    if name not in world.assets:
        yield Obstacle("no asset", name)
    elif asset is None or not asset.available:
        yield Obstacle("down", name)
    else:
        stays = ask.task in ("home", "report", "hold") or ask.place == world.base
        if asset.low_battery and not stays:
            yield Obstacle("low", name)
        if ask.task in VERB_FOR and asset.comms != "ok":
            yield Obstacle("poor link", name)
        if not can_do(asset.kind, ask.task):
            yield Obstacle("wrong kind", name, asset.kind)


def can_do(kind: AssetKind, task: Task) -> bool:
    """Return whether assets of a kind have the command for a task."""
    verb = VERB_FOR.get(task)
    return verb is None or kind in COMMANDS[verb].kinds
