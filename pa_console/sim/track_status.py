"""What a track is doing, concluded from its estimate: approaching, stopped, leaving, inside.

A conclusion needs motion well beyond the estimate's error and has to hold for a while, so that
noise does not change it at every scan.
"""

import math

from pa_console.schema.telemetry import TrackStatus
from pa_console.sim.sensing_state import TrackFile
from pa_console.sim.terrain import Terrain

CONFIRM_S = 1.0
"""So long the estimate must say the same before the status changes."""
SETTLED_S = 3.0
"""After a warning a contact gets this long before what it does counts as its answer."""
_MOVING_MPS, _MOVING_SIGMAS = 0.6, 3.0
_STANDING_MPS, _STANDING_SIGMAS = 0.4, 1.5
_KNOWN_SPEED_MPS = 2.0
_LEAST_MOVE_M, _PLACE_SIGMAS = 1.0, 4.0
_SLOW_MPS = 1.0
_STANDS_S = 20.0
"""One stands that has not moved while the slowest walker would have, or for this long."""
_DEFIANT_M = 2.0


def conclude(terrain: Terrain, file: TrackFile) -> None:
    """Update status, heading, gate and defiance of a track after a detection."""
    dt_s = terrain.world.dt_s
    depth = terrain.sight.depth(file.position)
    displaced = _displaced(terrain, file)
    says = _says(terrain, file, depth)
    if displaced is not None and says == file.status == "stopped":
        file.status = file.leaning = displaced
    elif says == file.status or says != file.leaning:
        file.leaning, file.leaning_tick = says, file.tick
    elif (file.tick - file.leaning_tick) * dt_s >= CONFIRM_S - 1e-9:
        file.status = says
    if is_moving(file):
        file.heading = math.atan2(file.vy, file.vx)
    if depth < 0.0 and file.status not in {"inside", "stopped"}:
        file.gate = terrain.sight.gate_of(file.position)
    _watch_defiance(terrain, file)


def is_moving(file: TrackFile) -> bool:
    """Return whether the estimated speed is beyond doubt."""
    limit = max(_MOVING_MPS, _MOVING_SIGMAS * math.sqrt(file.speed_variance))
    return math.hypot(file.vx, file.vy) > limit


def gap_to_gate(terrain: Terrain, file: TrackFile) -> float:
    """Return the distance from where a track was last detected to its gate, metres."""
    return math.dist(file.position, terrain.world.frames[file.gate].at)


def _displaced(terrain: Terrain, file: TrackFile) -> TrackStatus | None:
    """Return which way a track has moved since it last had, if that is beyond doubt.

    So one that creeps is not taken for stopped, however noisy its speed is.
    """
    if file.anchor is None:
        file.anchor, file.anchor_tick = file.position, file.tick
    if math.dist(file.anchor, file.position) <= _doubt_m(file):
        return None
    before = math.dist(file.anchor, terrain.world.frames[file.gate].at)
    file.anchor, file.anchor_tick = file.position, file.tick
    return "approaching" if gap_to_gate(terrain, file) < before else "leaving"


def _doubt_m(file: TrackFile) -> float:
    """Return how far apart two estimates of one place may be."""
    return max(_LEAST_MOVE_M, _PLACE_SIGMAS * math.sqrt(2.0) * file.sigma_m)


def _says(terrain: Terrain, file: TrackFile, depth_m: float) -> TrackStatus:
    """Return what the estimate alone says now; the present status if it says nothing clear."""
    margin = max(1.0, file.sigma_m)
    if depth_m > margin or (file.status == "inside" and depth_m > -margin):
        return "inside"
    if is_moving(file):
        gate = terrain.world.frames[file.gate].at
        closing = file.vx * (gate[0] - file.x) + file.vy * (gate[1] - file.y)
        return "approaching" if closing > 0.0 else "leaving"
    doubt = math.sqrt(file.speed_variance)
    standing = math.hypot(file.vx, file.vy) < max(_STANDING_MPS, _STANDING_SIGMAS * doubt)
    stood_s = (file.tick - file.anchor_tick) * terrain.world.dt_s
    long_enough = stood_s >= min(_STANDS_S, _doubt_m(file) / _SLOW_MPS)
    if standing and long_enough and doubt < _KNOWN_SPEED_MPS:
        return "stopped"
    return "approaching" if file.status == "inside" else file.status


def _watch_defiance(terrain: Terrain, file: TrackFile) -> None:
    """Notice that a warned contact goes on: nearer to its gate, or in, well beyond the error."""
    if file.warned_tick is None or file.defiant:
        return
    if (file.tick - file.warned_tick) * terrain.world.dt_s < SETTLED_S:
        return
    if file.warned_at is None:
        file.warned_at, file.warned_sigma_m = file.position, file.sigma_m
        file.warned_inside = file.status == "inside"
        return
    gate = terrain.world.frames[file.gate].at
    gained = math.dist(file.warned_at, gate) - gap_to_gate(terrain, file)
    if file.warned_inside:
        gained = -gained if file.status == "inside" else 0.0
    doubt = _MOVING_SIGMAS * math.hypot(file.sigma_m, file.warned_sigma_m)
    entered = file.status == "inside" and not file.warned_inside
    file.defiant = entered or gained > max(_DEFIANT_M, doubt)
