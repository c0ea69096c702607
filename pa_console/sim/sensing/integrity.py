"""Trust in reported positions, which are compared with physics, odometry and other sensors.

An asset becomes suspect if it jumps farther than its kind can move since the last report; if its
position creeps while it reports that it stands still (GPS drift); or if a gate camera, or a UAV at
the same gate, does not see it at its reported position. It stays suspect until its reports have
been sound for SOUND_S, or another sensor has seen it at its reported position for as long.

The following are not detected: drift below CREEP_M; drift of a moving asset, until it stops; a
forged report that repeats the asset's position, or gives a reachable position after a silence,
unless a camera or UAV watches the place; and false values other than the position (battery, task).
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from pa_console.schema.base import Point
from pa_console.schema.telemetry import AssetTelemetry, Weather
from pa_console.schema.world import World
from pa_console.sim import radio
from pa_console.sim.scene import Heard, PositionTrust, Report, Scene
from pa_console.sim.sensing.sensors import WEATHER
from pa_console.sim.worlds.terrain import Terrain

SPEED_MARGIN = 1.5
NOISE_M = 1.0
CREEP_M = 3.0
SEEN_M = 2.5
"""The accuracy, in metres, with which another sensor measures the position of an asset."""
GAP_PERIODS = 2.5
SOUND_S = 3.0
UNSEEN_S = 3.0
"""Seconds for which other sensors must miss an asset before it is suspect."""


def judge(world: World, record: Heard, report: Report) -> PositionTrust:
    """Return the trust in an asset's positions after `report`; `record` is the record before it."""
    trust, last, now = record.trust, record.telemetry.like, report.telemetry.like
    if trust.carried_tick is not None:
        return PositionTrust(stood=_standing(now))
    if not trust.suspect and now.position == last.position == trust.stood and _standing(now):
        return trust
    since_s = (report.stamp - record.stamp) * world.dt_s + report.held_up_s
    if not trust.suspect:
        if _possible(world, now, last.position, since_s) and not _creeps(
            world, now, trust, since_s
        ):
            return _sound(world, trust, now, since_s)
        return PositionTrust(
            stood=trust.stood, suspect=True, anchor=last.position, anchor_tick=record.stamp
        )
    if trust.sound_from is None:
        returned = _returned(world, trust, report, last, since_s)
        return replace(trust, sound_from=report.stamp) if returned else trust
    if not _possible(world, now, last.position, since_s) or _creeps(world, now, trust, since_s):
        return replace(trust, sound_from=None)
    if (report.stamp - trust.sound_from) * world.dt_s >= SOUND_S:
        return PositionTrust(stood=_standing(now))
    return trust


def compare(terrain: Terrain, scene: Scene, seen: Mapping[str, Point] | None = None) -> None:
    """Compare the reports of assets that stand at a gate with the detections of sensors there.

    A working camera at the gate recognizes an asset of the team that stands in its view, and so
    does a UAV whose own reports arrive from there. Call this once per telemetry period. `seen` has
    the positions at which sensors recognize assets; by default, these are the simulated positions.
    """
    world, station = terrain.world, scene.station
    fresh = scene.tick - round(2 * world.telemetry_period_s / world.dt_s)
    for gate, names in station.at_gate.items():
        watch: tuple[list[str], list[str]] | None = None
        for name in names:
            record = station.heard[name]
            at, trust = record.telemetry.like.position, record.trust
            place = scene.assets[name].position if seen is None else seen.get(name)
            there = place is not None and math.dist(at, place) <= SEEN_M
            if there and not trust.suspect and not trust.unseen:
                continue
            if record.stamp < fresh or _standing(record.telemetry.like) is None:
                continue
            cameras, drones = watch = watch or _watch(terrain, scene, gate, names, fresh)
            if any(drone != name for drone in drones) or any(
                _in_view(terrain, camera, at, scene.sensing.weather) for camera in cameras
            ):
                now = _witnessed(world, record, there)
                if now is not trust:
                    station.heard[name] = record._replace(trust=now)


def _watch(
    terrain: Terrain, scene: Scene, gate: str, names: Iterable[str], fresh: int
) -> tuple[list[str], list[str]]:
    """Return the working cameras at `gate`, and the UAVs in `names` whose detections count."""
    cameras = [
        name
        for name, camera in terrain.world.cameras.items()
        if camera.gate == gate and name not in scene.sensing.broken
    ]
    return cameras, [name for name in names if _witness(terrain.world, scene, name, fresh)]


@lru_cache(maxsize=4096)
def _in_view(terrain: Terrain, name: str, point: Point, weather: Weather) -> bool:
    """Return whether the camera `name` would certainly see an asset at `point`."""
    camera = terrain.world.cameras[name]
    dx, dy = point[0] - camera.at[0], point[1] - camera.at[1]
    off = math.remainder(math.atan2(dy, dx) - math.radians(camera.heading_deg), math.tau)
    return (
        math.hypot(dx, dy) <= camera.sensor_range_m * WEATHER[weather][0] - SEEN_M
        and abs(off) <= math.radians(camera.field_of_view_deg / 2)
        and bool(terrain.in_sight(np.array([camera.at]), np.array([point]))[0])
    )


def _witness(world: World, scene: Scene, name: str, fresh: int) -> bool:
    """Return whether `name` is a UAV that really reports, and detects, from its reported place."""
    asset, record = scene.assets[name], scene.station.heard[name]
    return (
        asset.kind == "uav"
        and record.stamp >= fresh
        and not record.trust.suspect
        and asset.spoofed is None
        and not asset.down
        and name not in scene.sensing.broken
        and radio.works(scene, asset)
        and math.dist(asset.position, record.telemetry.like.position)
        <= world.platforms["uav"].sensor_range_m / 2
    )


def _witnessed(world: World, record: Heard, there: bool) -> PositionTrust:
    """Return the trust after a further period; `there` is True if other sensors saw the asset."""
    trust, period_s = record.trust, world.telemetry_period_s
    if there:
        if not trust.suspect:
            return replace(trust, unseen=0) if trust.unseen else trust
        if (trust.seen + 1) * period_s >= SOUND_S:
            return PositionTrust(stood=record.telemetry.like.position)
        return replace(trust, seen=trust.seen + 1, unseen=0)
    at = record.telemetry.like.position
    if trust.suspect:
        return replace(trust, seen=0, lie=at, sound_from=None)
    if (trust.unseen + 1) * period_s >= UNSEEN_S:
        return PositionTrust(stood=None, suspect=True, anchor=at, anchor_tick=record.stamp, lie=at)
    return replace(trust, unseen=trust.unseen + 1)


def _possible(world: World, now: AssetTelemetry, before: Point, since_s: float) -> bool:
    """Return whether an asset of this kind can have moved from `before` in `since_s` seconds."""
    if now.position == before:
        return True
    limit = SPEED_MARGIN * world.platforms[now.kind].speed_mps * since_s + NOISE_M
    return math.dist(now.position, before) <= limit


def _creeps(world: World, now: AssetTelemetry, trust: PositionTrust, since_s: float) -> bool:
    """Return whether an asset that reports standing still has left its place.

    After a gap in its reports, this is False, because the asset may have moved and stopped again.
    """
    stood = trust.stood
    if stood is None or now.position == stood or _standing(now) is None:
        return False
    return not _gap(world, since_s) and math.dist(now.position, stood) > CREEP_M


def _standing(now: AssetTelemetry) -> Point | None:
    return now.position if now.speed_mps == 0.0 and not now.route else None


def _gap(world: World, since_s: float) -> bool:
    return since_s > GAP_PERIODS * world.telemetry_period_s


def _sound(
    world: World, trust: PositionTrust, now: AssetTelemetry, since_s: float
) -> PositionTrust:
    """Return the trust after a sound report; the asset may have moved during a gap."""
    stood = _standing(now)
    if stood is not None and trust.stood is not None and not _gap(world, since_s):
        stood = trust.stood
    return trust if stood == trust.stood else PositionTrust(stood=stood, unseen=trust.unseen)


def _returned(
    world: World, trust: PositionTrust, report: Report, last: AssetTelemetry, since_s: float
) -> bool:
    """Return whether a suspect asset's reports may be true again.

    They may be true if the asset is back where it stood. Otherwise, its position must be reachable
    from the last sound position, and away from the place where other sensors missed it. If there is
    no such place, the position must have jumped away from the doubtful positions.
    """
    now = report.telemetry.like
    if trust.stood is not None and math.dist(now.position, trust.stood) <= NOISE_M:
        return True
    age_s = (report.stamp - trust.anchor_tick) * world.dt_s
    if not _possible(world, now, trust.anchor, age_s):
        return False
    if trust.lie is not None:
        return math.dist(now.position, trust.lie) > CREEP_M
    odometer_m = 1.2 * max(now.speed_mps, last.speed_mps) * since_s + NOISE_M
    return math.dist(now.position, last.position) > odometer_m
