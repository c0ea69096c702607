"""Notices assets that make no headway and resolves it: one retreats, or the way is given up."""

import math
from functools import lru_cache

from pa_console.schema.base import Point
from pa_console.sim.assets.motion import way_left
from pa_console.sim.assets.obstructions import notice
from pa_console.sim.state.scene import AssetState, Scene
from pa_console.sim.worlds.routes import Route
from pa_console.sim.worlds.terrain import Terrain

PATIENCE_S = 3.0
MOST_STALLS = 10
RETREAT_M = 15.0
RETREAT_MORE_M = 5.0
_SWAP_EVERY = 5
_CHECK_S = 0.5
_HEADWAY_M = 0.05
_NEIGHBOUR_M = 4.0
_GROUP_M = 25.0


def unstick(terrain: Terrain, scene: Scene, asset: AssetState) -> str:
    """Look after an asset under way; return why it has to give up, '' while it need not.

    An asset that is stuck within its frame stays where it stands. Of two groups that block each
    other one retreats along its way, farther at every try, and lets the other by.
    """
    dt_s = terrain.world.dt_s
    if (scene.tick - asset.nearest_tick) % _check_ticks(dt_s):
        return ""
    left = way_left(asset)
    if left < asset.nearest_m - _HEADWAY_M:
        asset.nearest_m, asset.nearest_tick = left, scene.tick
        return ""
    turning_s = 180.0 / terrain.world.platforms[asset.kind].turn_rate_dps
    if (scene.tick - asset.nearest_tick) * dt_s < PATIENCE_S + turning_s:
        return ""
    asset.stalls += 1
    news = asset.kind != "uav" and notice(terrain, scene, asset)
    asset.nearest_m, asset.nearest_tick = math.inf, scene.tick
    if asset.post is not None and terrain.frame_at(asset.x, asset.y) == asset.post:
        asset.station, asset.route = asset.position, ()
        return ""
    if asset.stalls > MOST_STALLS:
        reason = f"it keeps its distance from {asset.held_by}" if asset.held_by else "blocked"
        return f"the way to {asset.post} is closed: {reason}"
    if news:
        way = _way(terrain, asset, asset.position, asset.station)
        asset.route = way or ()
        return "" if way else f"the way to {asset.post} is closed: something lies across it"
    _replan(terrain, scene, asset)
    return ""


@lru_cache
def _check_ticks(dt_s: float) -> int:
    return max(1, round(_CHECK_S / dt_s))


def _way(terrain: Terrain, asset: AssetState, start: Point, target: Point) -> Route | None:
    """Return a route round all that the asset knows of."""
    return terrain.planner.route(asset.kind, start, target, asset.obstructions)


def _replan(terrain: Terrain, scene: Scene, asset: AssetState) -> None:
    """Plan the rest of the way anew, after a retreat when it is this asset's turn to yield."""
    back: Route = ()
    if not asset.held_by and (_yields(terrain, scene, asset) or asset.stalls % _SWAP_EVERY == 0):
        way = _way(terrain, asset, asset.position, asset.origin) or ()
        back = _cut(asset.position, way, RETREAT_M + RETREAT_MORE_M * asset.stalls)
    start = back[-1] if back else asset.position
    onward = _way(terrain, asset, start, asset.station)
    if onward is not None:
        asset.route = (*back, *onward)


def _yields(terrain: Terrain, scene: Scene, asset: AssetState) -> bool:
    """Return whether this asset has to retreat, and not the ones that it meets.

    Of two groups that meet, the one with the earliest asset of the team goes first, so a whole
    queue retreats together. If no asset comes the other way, the later asset retreats.
    """
    widest = 2 * max(platform.radius_m for platform in terrain.world.platforms.values())
    near = [
        other
        for other in scene.assets.values()
        if other.kind != "uav"
        and other.route
        and not other.down
        and math.dist(asset.position, other.position) < widest + _GROUP_M
    ]
    against = [other.index for other in near if _opposed(asset, other)]
    if against:
        along = [other.index for other in near if not _opposed(asset, other)]
        return min(against) < min(along)
    reach = widest + _NEIGHBOUR_M
    return any(
        other.index < asset.index and math.dist(asset.position, other.position) < reach
        for other in near
    )


def _opposed(asset: AssetState, other: AssetState) -> bool:
    """Return whether the two legs lead opposite ways."""
    mine = (asset.station[0] - asset.origin[0], asset.station[1] - asset.origin[1])
    theirs = (other.station[0] - other.origin[0], other.station[1] - other.origin[1])
    return mine[0] * theirs[0] + mine[1] * theirs[1] < 0.0


def _cut(start: Point, way: Route, length_m: float) -> Route:
    """Return the first `length_m` metres of a way that leaves `start`."""
    kept: list[Point] = []
    here = start
    for point in way:
        step = math.dist(here, point)
        if step >= length_m:
            part = length_m / step if step else 0.0
            dx, dy = point[0] - here[0], point[1] - here[1]
            kept.append((here[0] + dx * part, here[1] + dy * part))
            break
        kept.append(point)
        here, length_m = point, length_m - step
    return tuple(kept)
