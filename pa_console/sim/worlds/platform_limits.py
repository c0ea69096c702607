"""The limits of each kind of asset within one step, computed once for a world."""

import math
from dataclasses import dataclass

from pa_console.schema.world import AssetKind, World

LOOK_M = 5.0
LOOK_S = 2.0
"""A ground asset looks out for others as far as it goes in LOOK_S, but no farther than LOOK_M."""
HULL_GAP_M = 0.15
_CORNER_M: dict[AssetKind, float] = {"uav": 1.5, "ugv": 0.5, "robot": 0.4}


@dataclass(frozen=True, slots=True)
class PlatformLimits:
    """The limits of one kind of asset: metres, metres a second, radians.

    It may turn by `turn_rad` in a step. A corner of its route counts as passed within `corner_m`.
    It looks for others within `look_m`; `apart_m` says how near the centres of it and of an asset
    of another kind may come.
    """

    flies: bool
    radius_m: float
    speed_mps: float
    turn_rad: float
    corner_m: float
    look_m: float
    apart_m: dict[AssetKind, float]


def platform_limits(world: World) -> dict[AssetKind, PlatformLimits]:
    """Return the limits of every kind of asset that `world` has a platform for."""
    return {
        kind: PlatformLimits(
            flies=kind == "uav",
            radius_m=platform.radius_m,
            speed_mps=platform.speed_mps,
            turn_rad=math.radians(platform.turn_rate_dps) * world.dt_s,
            corner_m=_CORNER_M[kind],
            look_m=min(LOOK_M, platform.speed_mps * LOOK_S) + platform.radius_m,
            apart_m={
                other: platform.radius_m + theirs.radius_m + HULL_GAP_M
                for other, theirs in world.platforms.items()
            },
        )
        for kind, platform in world.platforms.items()
    }
