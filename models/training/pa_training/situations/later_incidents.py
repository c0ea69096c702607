"""What can come between a plan and its success: things that happen just after it was approved."""

import random
from collections.abc import Iterator

from pa_console.policy.rule_variables import goes_to
from pa_console.schema.incident import DegradeAsset, FailAsset, Incident, ObstructWay, SetComms
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World

OBSTACLE_M = 30.0
"""Half the length of what lies across a way, in metres."""


def draw_later_incidents(
    plan: Plan, world: World, picture: Picture, rng: random.Random
) -> list[Incident]:
    """Return incidents that may keep `plan` from its success, in random order.

    Those that would halt it at once are left out: nobody judges the outcome of a halted plan.
    """
    found = [*_of_agents(plan, world, picture), *_of_guards(plan, world, picture)]
    rng.shuffle(found)
    return found


def _of_agents(plan: Plan, world: World, picture: Picture) -> Iterator[Incident]:
    for action in plan.actions:
        asset, name = picture.assets[action.agent], action.agent
        goal = goes_to(action, world)
        if goal not in world.frames or goal == asset.at:
            yield FailAsset(asset=name)
            yield SetComms(asset=name, comms="lost")
            continue
        yield DegradeAsset(asset=name, speed_factor=0.02)
        if asset.kind != "uav":
            yield _across(asset.position, world.frames[goal].at)


def _of_guards(plan: Plan, world: World, picture: Picture) -> Iterator[Incident]:
    """Yield failures of the only assets at gates with which the plan has nothing to do."""
    touched = {place for a in plan.actions for place in (goes_to(a, world), _post(a, picture))}
    for gate, cover in picture.gates.items():
        if len(cover.by) == 1 and gate not in touched:
            yield FailAsset(asset=cover.by[0])


def _post(action: Action, picture: Picture) -> str | None:
    return picture.assets[action.agent].post


def _across(start: tuple[float, ...], end: tuple[float, ...]) -> ObstructWay:
    """Return something that lies across the straight way, halfway along it."""
    middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    along = end[0] - start[0], end[1] - start[1]
    length = max(1.0, (along[0] ** 2 + along[1] ** 2) ** 0.5)
    across = -along[1] / length * OBSTACLE_M, along[0] / length * OBSTACLE_M
    return ObstructWay(
        start=(middle[0] - across[0], middle[1] - across[1]),
        end=(middle[0] + across[0], middle[1] + across[1]),
    )
