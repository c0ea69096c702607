"""Refuses plans that cannot even be started: unknown names, wrong kinds, an agent twice.

These are facts of the vocabulary, true under any rule file, so they carry their own id and
nobody can take them out of force. Nothing is dropped or mended: the plan comes back as it is.
"""

from collections import Counter
from collections.abc import Iterable

from pa_console.schema.finding import Finding
from pa_console.schema.plan import COMMANDS, Action, Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World

STRUCTURE_ID = "PLAN"


def problems(plan: Plan, world: World, picture: Picture) -> tuple[Finding, ...]:
    """Return one critical finding for everything that keeps `plan` from being rehearsed."""
    found = [text for action in plan.actions for text in _problems(action, world, picture)]
    found += [
        f"{agent} has {count} commands, at most one is allowed"
        for agent, count in Counter(plan.agents).items()
        if count > 1
    ]
    return tuple(
        Finding(rule_id=STRUCTURE_ID, priority="critical", status="violates", message=text)
        for text in dict.fromkeys(found)
    )


def _problems(action: Action, world: World, picture: Picture) -> Iterable[str]:
    spec = world.assets.get(action.agent)
    kinds = COMMANDS[action.verb].kinds
    if spec is None or action.agent not in picture.assets:
        yield f"agent {action.agent!r} does not exist; known: {', '.join(world.assets)}"
    elif spec.kind not in kinds:
        able = " or ".join(sorted(kinds))
        yield f"{action.agent} is a {spec.kind}; only a {able} can {action.verb}"
    if action.target is not None and action.target not in world.frames:
        yield f"frame {action.target!r} does not exist; known: {', '.join(world.frames)}"
