"""Facts in a picture about an asset that might be sent: its distance, and what speaks against it.

They use the same measure as the planner's list of free assets.
"""

import math
from collections.abc import Iterator

from pa_console.language.picture_facts import is_free, sole_covers
from pa_console.policy.checks.check_context import goes_to
from pa_console.schema.command import BUSY_TASKS, COMMANDS
from pa_console.schema.plan import Action
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.world import PLAIN_KINDS, World


def distance_m(name: str, action: Action, world: World, picture: Picture) -> float | None:
    """Return how far an asset is from where `action` leads, in metres; None where nowhere."""
    place, asset = goal_of(action, world), picture.assets.get(name)
    if not place or asset is None:
        return None
    return math.dist(asset.position, world.frames[place].at)


def goal_of(action: Action, world: World) -> str:
    """Return the frame that `action` leads to; '' where it leads nowhere."""
    place = action.target or goes_to(action, world) or ""
    return place if place in world.frames else ""


def is_able(name: str, action: Action, world: World) -> bool:
    """Return whether an asset's kind has the command of `action`."""
    return world.assets[name].kind in COMMANDS[action.verb].kinds


def who_is_able(action: Action) -> str:
    """Return in words which kinds have the command of `action`."""
    kinds = [PLAIN_KINDS[kind] for kind in PLAIN_KINDS if kind in COMMANDS[action.verb].kinds]
    return f"only a {' or '.join(kinds)} can {action.verb}"


def may_leave(name: str, picture: Picture) -> bool:
    """Return whether an asset may leave without uncovering a gate or giving up its task."""
    asset = picture.assets.get(name)
    return asset is not None and is_free(asset, sole_covers(picture).values())


def against(name: str, picture: Picture) -> list[str]:
    """Return the facts in the picture against sending an asset away; none if it is free."""
    asset = picture.assets.get(name)
    if asset is None:
        return ["nothing is known of it"]
    alone = [gate for gate, guard in sole_covers(picture).items() if guard == name]
    return [*_state(asset, picture), *(f"it alone covers {gate}" for gate in alone)]


def _state(asset: AssetTelemetry, picture: Picture) -> Iterator[str]:
    age_s = picture.time_s - asset.stamp_s
    if asset.status == "failed":
        yield "it has failed"
    elif asset.comms == "lost" or asset.stale:
        yield f"it has been silent for {age_s:.0f} s"
    elif asset.integrity == "suspect":
        yield "its telemetry cannot be right"
    elif not asset.available:
        yield "it is not available"
    if asset.low_battery:
        yield f"its battery is low, {asset.battery_pct:.0f} %"
    if asset.task in BUSY_TASKS:
        yield f"it is busy: {asset.task}"
