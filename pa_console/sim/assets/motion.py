"""Drives assets along their routes: turning, slowing, giving way, keeping the standoff."""

import math
from collections.abc import Sequence

from pa_console.schema.base import Point
from pa_console.schema.world import Platform
from pa_console.sim.assets.physics import CONTACT_MARGIN_M, Velocity
from pa_console.sim.assets.surroundings import Traffic
from pa_console.sim.state import AssetState, Scene
from pa_console.sim.worlds.terrain import Terrain

ARRIVAL_M = 0.3
_CORNER_M = {"uav": 1.5, "ugv": 0.5, "robot": 0.4}
_LOOK_M = 5.0
_LOOK_S = 2.0
_HULL_GAP_M = 0.15
_SLOWING_S = 0.6
_TURNS = tuple(math.radians(turn) for turn in (0, -25, 25, -50, 50, -75, 75, -100, 100))
"""Ways to pass something, best first: of two equal ones the right-hand one."""


def traffic(terrain: Terrain, scene: Scene) -> Traffic:
    """Return the ground assets as they stand now, looked up as far as one has to give way."""
    widest = max(platform.radius_m for platform in terrain.world.platforms.values())
    standing_m = max(_LOOK_M + 3 * widest + _HULL_GAP_M, terrain.contact_m + CONTACT_MARGIN_M)
    return Traffic(scene, standing_m, standing_m + _LOOK_M)


def drive(terrain: Terrain, scene: Scene, ground: Traffic, dt_s: float) -> dict[str, Velocity]:
    """Turn every asset that has a route toward it; return the velocities (m/s) of those moving."""
    velocities: dict[str, Velocity] = {}
    tracks = [(contact.id, contact.position) for contact in scene.contacts.values()]
    for asset in scene.busy():
        if not asset.route or asset.down:
            asset.speed = 0.0
            continue
        _pass_corners(asset)
        if not asset.route:
            asset.speed = 0.0
            continue
        direction: float | None = _bearing(asset, asset.route[0])
        if asset.kind != "uav":
            direction = give_way(terrain, asset, ground.near(asset), direction)
        velocity = _steer(asset, terrain.world.platforms[asset.kind], direction, dt_s)
        asset.held_by = ""
        if asset.kind != "uav" and tracks:
            asset.held_by = _too_near(asset, velocity, tracks, terrain.world.standoff_m, dt_s)
        if asset.held_by:
            asset.speed = 0.0
        elif velocity != (0.0, 0.0):
            velocities[asset.id] = velocity
    return velocities


def way_left(asset: AssetState) -> float:
    """Return the metres still ahead on the asset's route."""
    left, here = 0.0, asset.position
    for point in asset.route:
        left += math.dist(here, point)
        here = point
    return left


def _bearing(asset: AssetState, point: Point) -> float:
    return math.atan2(point[1] - asset.y, point[0] - asset.x)


def _pass_corners(asset: AssetState) -> None:
    """Drop the waypoints that are reached: corners roughly, the last one closely."""
    for index, point in enumerate(asset.route):
        limit = _CORNER_M[asset.kind] if index + 1 < len(asset.route) else ARRIVAL_M
        if math.dist(asset.position, point) > limit:
            asset.route = asset.route[index:]
            return
    asset.route = ()


def _steer(asset: AssetState, platform: Platform, direction: float | None, dt_s: float) -> Velocity:
    """Turn toward `direction` (radians) at most at the turn rate and go as far as it points there.

    None means stand and wait.
    """
    if direction is None:
        asset.speed = 0.0
        return (0.0, 0.0)
    most = math.radians(platform.turn_rate_dps) * dt_s
    error = math.remainder(direction - asset.heading, math.tau)
    asset.heading = math.remainder(asset.heading + min(most, max(-most, error)), math.tau)
    rest = math.remainder(direction - asset.heading, math.tau)
    ahead = math.cos(rest)
    fastest = platform.speed_mps * asset.speed_factor
    speed = fastest * ahead * ahead if ahead > 0.5 else 0.0
    gap = math.dist(asset.position, asset.route[0])
    if len(asset.route) == 1:
        speed = min(speed, max(gap / _SLOWING_S, 0.3 * ahead))
    asset.speed = max(0.0, min(speed, gap / dt_s))
    return (asset.speed * math.cos(asset.heading), asset.speed * math.sin(asset.heading))


def give_way(
    terrain: Terrain, asset: AssetState, ground: Sequence[AssetState], wanted: float
) -> float | None:
    """Return the direction nearest to `wanted` in which nothing is run into, None to wait."""
    platforms = terrain.world.platforms
    mine = platforms[asset.kind]
    look = min(_LOOK_M, mine.speed_mps * _LOOK_S) + mine.radius_m
    reach = {k: mine.radius_m + p.radius_m + _HULL_GAP_M for k, p in platforms.items()}
    near: list[tuple[float, float, float, float, float]] = []
    for other in ground:
        dx, dy = other.x - asset.x, other.y - asset.y
        radius = reach[other.kind]
        limit = look + radius + (min(other.speed * _LOOK_S, _LOOK_M) if other.speed else 0.0)
        if other is not asset and dx * dx + dy * dy < limit * limit:
            vx, vy = other.speed * math.cos(other.heading), other.speed * math.sin(other.heading)
            near.append((dx, dy, vx, vy, radius))
    if not near:
        return wanted
    horizon = min(_LOOK_S, math.dist(asset.position, asset.route[0]) / mine.speed_mps + 0.2)
    area = terrain.planner.area(asset.kind, asset.position, asset.station, avoid=asset.obstructions)
    free_here = area.contains(asset.x, asset.y)
    for turn in _TURNS:
        vx = mine.speed_mps * math.cos(wanted + turn)
        vy = mine.speed_mps * math.sin(wanted + turn)
        if any(_meets(vx, vy, other, horizon) for other in near):
            continue
        if turn and free_here and not area.contains(asset.x + vx * 0.5, asset.y + vy * 0.5):
            continue
        return wanted + turn
    return None


def _meets(
    vx: float, vy: float, other: tuple[float, float, float, float, float], horizon: float
) -> bool:
    """Return whether going at (vx, vy) comes too near `other` (dx, dy, vx, vy, reach) in time.

    Something already too near is met only by going closer still.
    """
    dx, dy, ux, uy, reach = other
    rx, ry = ux - vx, uy - vy
    closing = -(dx * rx + dy * ry)
    if closing <= 0.0:
        return False
    if dx * dx + dy * dy <= reach * reach:
        return True
    when = min(closing / (rx * rx + ry * ry), horizon)
    return math.hypot(dx + rx * when, dy + ry * when) < reach


def _too_near(
    asset: AssetState,
    velocity: Velocity,
    tracks: Sequence[tuple[str, Point]],
    standoff_m: float,
    dt_s: float,
) -> str:
    """Return the track that the step would bring nearer than the standoff (ROE-04), or ''."""
    there = (asset.x + velocity[0] * dt_s, asset.y + velocity[1] * dt_s)
    limit = standoff_m + 0.2
    for name, point in tracks:
        if abs(point[0] - there[0]) >= limit or abs(point[1] - there[1]) >= limit:
            continue
        gap = math.dist(there, point)
        if gap < limit and gap < math.dist(asset.position, point):
            return name
    return ""
