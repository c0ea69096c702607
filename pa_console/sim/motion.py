"""The motion of assets along their routes: turning, slowing, giving way, keeping the standoff.

An asset that makes no progress retreats, finds another way, or gives up.
"""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from math import atan2, cos, dist, hypot, remainder, sin, tau

from pa_console.schema.base import Point
from pa_console.sim.physics import CONTACT_MARGIN_M, Traffic, Velocity, gap
from pa_console.sim.scene import AssetState, Scene
from pa_console.sim.worlds.routes import Area, Route
from pa_console.sim.worlds.terrain import HULL_GAP_M, LOOK_M, LOOK_S, PlatformLimits, Terrain

ARRIVAL_M = 0.3
_SLOWING_S = 0.6
_TURNS = tuple(math.radians(turn) for turn in (0, -25, 25, -50, 50, -75, 75, -100, 100))
"""Turns to pass an obstacle, best first; of two equal turns, the right-hand turn comes first."""
_STANDS: Velocity = (0.0, 0.0)
_Other = tuple[float, float, float, float, float]
"""Another asset relative to this one: (dx, dy, vx, vy, reach), in metres and metres per second."""

PATIENCE_S = 3.0
MOST_STALLS = 10
RETREAT_M = 15.0
RETREAT_MORE_M = 5.0
_SWAP_EVERY = 5
_CHECK_S = 0.5
_HEADWAY_M = 0.05
_NEIGHBOUR_M = 4.0
_GROUP_M = 25.0
_OBSTRUCTION_SEEN_M = 3.0
"""The distance from its hull at which a stuck ground asset detects obstructions, in metres."""


def traffic(terrain: Terrain, scene: Scene) -> Traffic:
    """Return the ground assets at their present places, with the neighbours to give way to."""
    widest = max(limits.radius_m for limits in terrain.limits.values())
    standing_m = LOOK_M + 3 * widest + HULL_GAP_M
    close_m = terrain.contact_m + CONTACT_MARGIN_M
    return Traffic(scene.assets.values(), standing_m, standing_m + LOOK_M, close_m)


def drive(
    terrain: Terrain, scene: Scene, busy: Sequence[AssetState], ground: Traffic, dt_s: float
) -> dict[str, Velocity]:
    """Steer every asset with a route; return the velocities (m/s) of those that move."""
    ground.go(scene.active)
    velocities: dict[str, Velocity] = {}
    tracks = [(contact.id, contact.position) for contact in scene.contacts.values()]
    for asset in busy:
        limits = terrain.limits[asset.kind]
        gap = _pass_corners(asset, limits.corner_m) if asset.route and not asset.down else 0.0
        if gap == 0.0:
            asset.speed = 0.0
            continue
        x, y = asset.route[0]
        direction: float | None = atan2(y - asset.y, x - asset.x)
        if not limits.flies and (near := _in_the_way(asset, limits, ground.around(asset).near)):
            situation = (asset.position, asset.route[0], asset.station, asset.obstructions, *near)
            if ground.waiting.get(asset.id) == situation:
                direction = None
            else:
                direction = give_way(terrain, asset, near, direction)
                ground.waiting[asset.id] = situation if direction is None else None
        velocity = _steer(asset, limits, direction, gap, dt_s)
        asset.held_by = ""
        if tracks and not limits.flies:
            asset.held_by = _too_near(asset, velocity, tracks, terrain.world.standoff_m, dt_s)
        if asset.held_by:
            asset.speed = 0.0
        elif velocity != _STANDS:
            velocities[asset.id] = velocity
    return velocities


def way_left(asset: AssetState) -> float:
    """Return the remaining length of the asset's route in metres."""
    left, here = 0.0, asset.position
    for point in asset.route:
        left += dist(here, point)
        here = point
    return left


def _pass_corners(asset: AssetState, corner_m: float) -> float:
    """Drop the waypoints that are reached: corners within `corner_m`, the last within ARRIVAL_M.

    Return the distance in metres to the next remaining waypoint, 0.0 if there is none.
    """
    here, route = (asset.x, asset.y), asset.route
    last = len(route) - 1
    for index, point in enumerate(route):
        gap = dist(here, point)
        if gap > (corner_m if index < last else ARRIVAL_M):
            if index:
                asset.route = route[index:]
            return gap
    asset.route = ()
    return 0.0


def _steer(
    asset: AssetState, limits: PlatformLimits, direction: float | None, gap: float, dt_s: float
) -> Velocity:
    """Turn toward `direction` (radians), at most at the turn rate, and return the velocity.

    The speed falls with the angle between heading and direction. `gap` is the distance to the next
    waypoint in metres. A direction of None means stop and wait.
    """
    if direction is None:
        asset.speed = 0.0
        return _STANDS
    most = limits.turn_rad
    error = remainder(direction - asset.heading, tau)
    turn = most if error > most else -most if error < -most else error
    heading = remainder(asset.heading + turn, tau)
    ahead = cos(remainder(direction - heading, tau))
    speed = limits.speed_mps * asset.speed_factor * ahead * ahead if ahead > 0.5 else 0.0
    if len(asset.route) == 1:
        speed = min(speed, max(gap / _SLOWING_S, 0.3 * ahead))
    speed = min(speed, gap / dt_s)
    asset.heading, asset.speed = heading, speed
    return (speed * cos(heading), speed * sin(heading))


def give_way(
    terrain: Terrain, asset: AssetState, near: list[_Other], wanted: float
) -> float | None:
    """Return the free direction nearest to `wanted`, or None to wait."""
    speed = terrain.limits[asset.kind].speed_mps
    horizon = min(LOOK_S, dist(asset.position, asset.route[0]) / speed + 0.2)
    area: Area | None = None
    for turn in _TURNS:
        vx = speed * cos(wanted + turn)
        vy = speed * sin(wanted + turn)
        if _meets_any(vx, vy, near, horizon):
            continue
        if turn:
            area = area or terrain.planner.area(
                asset.kind, asset.position, asset.station, avoid=asset.obstructions
            )
            leaves = not area.contains(asset.x + vx * 0.5, asset.y + vy * 0.5)
            if leaves and area.contains(asset.x, asset.y):
                continue
        return wanted + turn
    return None


def _in_the_way(
    asset: AssetState, limits: PlatformLimits, ground: Iterable[AssetState]
) -> list[_Other]:
    """Return the assets of `ground` that `asset` may meet within its look-ahead time."""
    near: list[_Other] = []
    x, y, look_m, apart_m = asset.x, asset.y, limits.look_m, limits.apart_m
    for other in ground:
        dx, dy = other.x - x, other.y - y
        radius, speed = apart_m[other.kind], other.speed
        limit = look_m + radius + (min(speed * LOOK_S, LOOK_M) if speed else 0.0)
        if dx * dx + dy * dy < limit * limit:
            way = other.heading
            velocity = (speed * cos(way), speed * sin(way)) if speed else _STANDS
            near.append((dx, dy, *velocity, radius))
    return near


def _meets_any(vx: float, vy: float, near: list[_Other], horizon: float) -> bool:
    """Return whether moving at (vx, vy) comes too near one of `near` in time.

    An asset that is already too near is met only if the move brings it closer. An asset that is met
    moves to the front of the list, because the next direction tried will probably meet it too.
    """
    for index, (dx, dy, ux, uy, reach) in enumerate(near):
        rx, ry = ux - vx, uy - vy
        closing = -(dx * rx + dy * ry)
        if closing <= 0.0:
            continue
        if dx * dx + dy * dy > reach * reach:
            when = min(closing / (rx * rx + ry * ry), horizon)
            if hypot(dx + rx * when, dy + ry * when) >= reach:
                continue
        near[0], near[index] = near[index], near[0]
        return True
    return False


def _too_near(
    asset: AssetState,
    velocity: Velocity,
    tracks: Sequence[tuple[str, Point]],
    standoff_m: float,
    dt_s: float,
) -> str:
    """Return the track that this step would bring nearer than the standoff (ROE-04), or ''."""
    there = (asset.x + velocity[0] * dt_s, asset.y + velocity[1] * dt_s)
    limit = standoff_m + 0.2
    for name, point in tracks:
        if abs(point[0] - there[0]) >= limit or abs(point[1] - there[1]) >= limit:
            continue
        gap = dist(there, point)
        if gap < limit and gap < dist(asset.position, point):
            return name
    return ""


def unstick(terrain: Terrain, scene: Scene, asset: AssetState) -> str:
    """Check the progress of an asset under way; return why it must give up, or ''.

    An asset that is stuck within its frame stays where it is. If two groups block each other, one
    group retreats along its route, farther at each attempt, and lets the other pass.
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
    news = asset.kind != "uav" and _notice(terrain, scene, asset)
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
    """Return a route around all obstructions that the asset has detected."""
    return terrain.planner.route(asset.kind, start, target, asset.obstructions)


def _replan(terrain: Terrain, scene: Scene, asset: AssetState) -> None:
    """Plan the rest of the route again, after a retreat if this asset has to yield."""
    back: Route = ()
    if not asset.held_by and (_yields(terrain, scene, asset) or asset.stalls % _SWAP_EVERY == 0):
        way = _way(terrain, asset, asset.position, asset.origin) or ()
        back = _cut(asset.position, way, RETREAT_M + RETREAT_MORE_M * asset.stalls)
    start = back[-1] if back else asset.position
    onward = _way(terrain, asset, start, asset.station)
    if onward is not None:
        asset.route = (*back, *onward)


def _yields(terrain: Terrain, scene: Scene, asset: AssetState) -> bool:
    """Return whether this asset has to retreat, rather than the assets that it meets.

    Of two groups that meet, the one with the asset listed first in the team goes first, so a whole
    queue retreats together. If no asset comes the other way, the asset listed later retreats.
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
    """Return whether the two assets' legs lead in opposite directions."""
    mine = (asset.station[0] - asset.origin[0], asset.station[1] - asset.origin[1])
    other_way = (other.station[0] - other.origin[0], other.station[1] - other.origin[1])
    return mine[0] * other_way[0] + mine[1] * other_way[1] < 0.0


def _cut(start: Point, way: Route, length_m: float) -> Route:
    """Return the first `length_m` metres of a route that begins at `start`."""
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


def _notice(terrain: Terrain, scene: Scene, asset: AssetState) -> bool:
    """Add the obstructions near a stuck ground asset to its list; return whether any is new."""
    reach = terrain.world.platforms[asset.kind].radius_m + _OBSTRUCTION_SEEN_M
    news = tuple(
        wall
        for wall in scene.obstructions
        if wall not in asset.obstructions and gap(wall, asset.x, asset.y) <= reach
    )
    asset.obstructions = (*asset.obstructions, *news)
    return bool(news)
