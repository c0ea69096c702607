"""The station's tracks: the detections of each contact, combined into one estimate.

The model is constant velocity with random acceleration. Both axes have the same covariance, because
measurement noise has no direction. No random numbers are drawn, so equal detections give equal
estimates.

A conclusion needs motion well beyond the estimate's error and must hold for a while, so that noise
does not change it at every scan.

The contact's signature (plate, shape, gait) determines which detections belong together, so
association is perfect; position, velocity and everything derived from them are estimated.
"""

import math

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Track, TrackStatus
from pa_console.sim.scene import Scene
from pa_console.sim.sensing import evidence
from pa_console.sim.sensing.evidence import (
    disputed_claims,
    hostile_by,
    identity_of,
    intent_of,
    suspects_noncombatants,
)
from pa_console.sim.sensing_state import Detection, Sighting, TrackFile
from pa_console.sim.worlds.terrain import Terrain

ACCELERATION_MPS2 = 1.0
"""The standard deviation of the acceleration that a contact may have at any time."""
SPEED_SIGMA_MPS = 8.0
"""The standard deviation of the speed, on each axis, of a contact without an estimate."""
LEAST_SIGMA_M = 0.05
_SURPRISE = 18.4
"""The squared error, in sigmas, that one in ten thousand measurements exceeds in two dimensions."""

CONFIRM_S = 1.0
"""Seconds for which a conclusion must hold before the status changes."""
SETTLED_S = 3.0
"""Seconds after a warning before a contact's behaviour counts as its response."""
_MOVING_MPS, _MOVING_SIGMAS = 0.6, 3.0
_STANDING_MPS, _STANDING_SIGMAS = 0.4, 1.5
_KNOWN_SPEED_MPS = 2.0
_LEAST_MOVE_M, _PLACE_SIGMAS = 1.0, 4.0
_SLOW_MPS = 1.0
_STANDS_S = 20.0
"""The time in seconds without movement after which a track counts as standing, even if the slowest
walker could have stayed within the error of the estimate."""
_DEFIANT_M = 2.0
DROP_S = 20.0
"""Seconds after which a track that is no longer detected is dropped."""
SEEN_PERIODS = 3
"""The number of telemetry periods for which a detection counts as present."""


def measure(file: TrackFile, at: Point, sigma_m: float, tick: int, dt_s: float) -> None:
    """Add a measurement made at `tick`; an older one is first extrapolated to the latest tick.

    A surprising measurement means that the contact's motion has changed, so the speed is estimated
    again.
    """
    noise = max(sigma_m, LEAST_SIGMA_M) ** 2
    if file.variance == 0.0:
        (file.x, file.y), file.variance = at, noise
        file.covariance, file.speed_variance = 0.0, SPEED_SIGMA_MPS**2
        return
    elapsed = (tick - file.tick) * dt_s
    if elapsed > 0.0:
        _predict(file, elapsed)
        file.tick = tick
    elif elapsed < 0.0:
        at = (at[0] - elapsed * file.vx, at[1] - elapsed * file.vy)
        noise += file.speed_variance * elapsed**2
    error_x, error_y = at[0] - file.x, at[1] - file.y
    spread = file.variance + noise
    if error_x**2 + error_y**2 > _SURPRISE * spread:
        file.variance += error_x**2 + error_y**2
        file.covariance, file.speed_variance = 0.0, SPEED_SIGMA_MPS**2
        spread = file.variance + noise
    gain, speed_gain = file.variance / spread, file.covariance / spread
    file.x += gain * error_x
    file.y += gain * error_y
    file.vx += speed_gain * error_x
    file.vy += speed_gain * error_y
    file.speed_variance -= speed_gain * file.covariance
    file.covariance *= 1.0 - gain
    file.variance *= 1.0 - gain


def _predict(file: TrackFile, seconds: float) -> None:
    """Extrapolate the estimate by `seconds`."""
    q = ACCELERATION_MPS2**2
    file.x += file.vx * seconds
    file.y += file.vy * seconds
    file.variance += (
        2.0 * file.covariance * seconds + file.speed_variance * seconds**2 + q * seconds**4 / 4.0
    )
    file.covariance += file.speed_variance * seconds + q * seconds**3 / 2.0
    file.speed_variance += q * seconds**2


def conclude(terrain: Terrain, file: TrackFile) -> None:
    """Update status, heading, gate and defiance of a track after a detection."""
    dt_s = terrain.world.dt_s
    depth = terrain.depth(file.position)
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
        file.gate = terrain.gate_of(file.position)
    _watch_defiance(terrain, file)


def is_moving(file: TrackFile) -> bool:
    """Return whether the contact certainly moves, according to its estimated speed."""
    limit = max(_MOVING_MPS, _MOVING_SIGMAS * math.sqrt(file.speed_variance))
    return math.hypot(file.vx, file.vy) > limit


def gap_to_gate(terrain: Terrain, file: TrackFile) -> float:
    """Return the distance from a track's last detection to its gate in metres."""
    return math.dist(file.position, terrain.world.frames[file.gate].at)


def _displaced(terrain: Terrain, file: TrackFile) -> TrackStatus | None:
    """Return the status of a track that has certainly moved since its last certain move, else None.

    This keeps a creeping track from counting as stopped, however noisy its speed is.
    """
    if file.anchor is None:
        file.anchor, file.anchor_tick = file.position, file.tick
    if math.dist(file.anchor, file.position) <= _doubt_m(file):
        return None
    before = math.dist(file.anchor, terrain.world.frames[file.gate].at)
    file.anchor, file.anchor_tick = file.position, file.tick
    return "approaching" if gap_to_gate(terrain, file) < before else "leaving"


def _doubt_m(file: TrackFile) -> float:
    """Return how far apart, in metres, two estimates of the same place may be."""
    return max(_LEAST_MOVE_M, _PLACE_SIGMAS * math.sqrt(2.0) * file.sigma_m)


def _says(terrain: Terrain, file: TrackFile, depth_m: float) -> TrackStatus:
    """Return the status that the estimate alone suggests; the present status if it is unclear."""
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
    """Detect that a warned contact continues.

    It continues if it comes nearer to its gate by more than the error, if it enters, or if it moves
    on inside.
    """
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


def receive(
    terrain: Terrain, scene: Scene, sensor: str, stamp: int, detections: tuple[Detection, ...]
) -> None:
    """Process the detections of `sensor` at tick `stamp`; a new contact becomes a track."""
    state = scene.sensing
    for detection in detections:
        if detection.contact in state.cleared:
            continue
        file = state.files.get(detection.contact)
        if file is None and detection.position is not None:
            file = _open(terrain, scene, stamp, detection, detection.position)
        elif file is not None and detection.position is not None:
            measure(file, detection.position, detection.sigma_m, stamp, terrain.world.dt_s)
        if file is not None:
            evidence.learn(terrain, scene, file, sensor, stamp, detection)
            _note(terrain, file, sensor, stamp, detection)


def review(terrain: Terrain, scene: Scene) -> None:
    """Update the status of each track that was detected since the last review.

    A track that has not been detected for DROP_S seconds is dropped.
    """
    for contact, file in list(scene.sensing.files.items()):
        if terrain.seconds(scene.tick - file.tick) >= DROP_S:
            del scene.sensing.files[contact]
        elif file.tick > file.reviewed_tick:
            file.reviewed_tick = file.tick
            conclude(terrain, file)


def name_of(scene: Scene, contact: str) -> str:
    """Return the station's track id for a contact, or '' if it is not tracked."""
    file = scene.sensing.files.get(contact)
    return "" if file is None else file.id


def _open(terrain: Terrain, scene: Scene, stamp: int, detection: Detection, at: Point) -> TrackFile:
    """Begin a track with the next number; it is assumed to head for its gate."""
    state = scene.sensing
    state.numbered += 1
    gate = terrain.gate_of(at)
    ahead = terrain.world.frames[gate].at
    file = TrackFile(
        id=f"Track_{state.numbered:02d}",
        contact=detection.contact,
        kind=detection.kind,
        gate=gate,
        x=at[0],
        y=at[1],
        heading=math.atan2(ahead[1] - at[1], ahead[0] - at[0]),
        variance=0.0,
        tick=stamp,
        first_tick=stamp,
    )
    measure(file, at, detection.sigma_m, stamp, terrain.world.dt_s)
    state.files[detection.contact] = file
    return file


def _note(terrain: Terrain, file: TrackFile, sensor: str, stamp: int, detection: Detection) -> None:
    """Store the time and place of a sensor's detection, and whether the contact was warned."""
    if detection.position is not None:
        latest = next((sighting for sighting in file.seen if sighting.sensor == sensor), None)
        if latest is None or stamp >= latest.tick:
            others = tuple(sighting for sighting in file.seen if sighting.sensor != sensor)
            file.seen = (*others, Sighting(sensor, stamp, detection.position))
        asset = terrain.world.assets.get(sensor)
        file.observed = file.observed or (asset is not None and asset.kind == "uav")
    if detection.warned_tick is not None and file.warned_tick is None:
        file.warned_tick = detection.warned_tick


def tracks_known(terrain: Terrain, scene: Scene) -> dict[str, Track]:
    """Return the tracks for the picture, from the detections that arrived."""
    if not scene.sensing.files:
        return {}
    review(terrain, scene)
    return {file.id: known_track(terrain, scene, file) for file in scene.sensing.files.values()}


def known_track(terrain: Terrain, scene: Scene, file: TrackFile) -> Track:
    """Return the track of a file; `position` is that of the last detection."""
    world = terrain.world
    recent = scene.tick - round(SEEN_PERIODS * world.telemetry_period_s / world.dt_s)
    seen_by = tuple(sorted(sighting.sensor for sighting in file.seen if sighting.tick >= recent))
    age_s = terrain.seconds(scene.tick - file.tick)
    speed = 0.0 if file.status == "stopped" else math.hypot(file.vx, file.vy)
    return Track(
        id=file.id,
        kind=file.kind,
        gate=file.gate,
        position=(round(file.x, 3), round(file.y, 3)),
        heading_deg=round(math.degrees(file.heading), 1),
        speed_mps=round(speed, 3),
        distance_m=round(gap_to_gate(terrain, file), 3),
        identity=identity_of(file),
        intent=intent_of(file),
        status=file.status,
        observed_by=tuple(
            s for s in seen_by if s in world.assets and world.assets[s].kind == "uav"
        ),
        observed=file.observed,
        warned=file.warned_tick is not None,
        stamp_s=terrain.seconds(file.tick),
        first_seen_s=terrain.seconds(file.first_tick),
        stale=age_s > world.stale_s,
        uncertainty_m=round(file.sigma_m + speed * age_s, 3),
        seen_by=seen_by,
        hostile_by=hostile_by(file),
        noncombatants=suspects_noncombatants(terrain, file),
        emergency=file.emergency,
        defiant=file.defiant,
        identity_claims=disputed_claims(file),
    )
