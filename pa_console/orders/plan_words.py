"""What a plan does, in the canonical words of orders."""

from collections.abc import Iterable, Sequence

from pa_console.orders.clauses import NOTHING, TEAM, counted, written
from pa_console.orders.order import TASK_OF
from pa_console.schema.plan import Action
from pa_console.schema.world import KINDS, World

MOST_NAMED = 4
"""More assets than these with one task are only counted."""


def planned(actions: Sequence[Action], world: World, *, by_name: bool) -> str:
    """Return what the actions do, e.g. "1 drone to EastGate; Robot_T01 home" with names if asked.

    A plan in which one asset holds and nothing else happens is "hold".
    """
    if [action.verb for action in actions] == ["hold"] and not by_name:
        return "hold"
    tasks: dict[str, list[Action]] = {}
    for action in actions:
        tasks.setdefault(action.command, []).append(action)
    return "; ".join(_task(group, world, by_name) for group in tasks.values()) or NOTHING


def _task(actions: Sequence[Action], world: World, by_name: bool) -> str:
    names = [action.agent for action in actions]
    who = ", ".join(names) if by_name and len(names) <= MOST_NAMED else _counted(names, world)
    target = actions[0].target
    where = {"place": target, "gate": target} if target else {}
    return written(TASK_OF[actions[0].verb], {"who": who, **where})


def _counted(names: Iterable[str], world: World) -> str:
    kinds = [world.assets[name].kind for name in names]
    return ", ".join(
        TEAM.write(counted(kind, kinds.count(kind))) for kind in KINDS if kind in kinds
    )
