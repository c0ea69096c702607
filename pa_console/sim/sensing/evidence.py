"""Evidence about contacts: the sensors' statements and the station's conclusions.

A statement counts only if, by the positions known to the station, the contact was within the
sensor's reach. A sensor has one vote: its latest statement replaces the earlier one. Votes are
weighted by the kind of sensor. If sensors contradict each other, the identity is unknown, unless
several sensors agree against a single one.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Identity, IdentityClaim, Intent
from pa_console.schema.world import Sensing, World
from pa_console.sim.scene import Scene
from pa_console.sim.sensing.sensors import CLOSE_STANDOFFS
from pa_console.sim.sensing_state import Detection, Statement, TrackFile
from pa_console.sim.worlds.terrain import Terrain

ROBOT_WEIGHT, OTHER_WEIGHT = 2, 1
"""The weights of a ground robot, which has dealt with the contact (`identify`), and of another
sensor, which has only observed it."""
NEEDED_WEIGHT = 2
"""The least weight that supports an identity: one ground robot, or two other sensors."""
TWO_SENSORS = 2
"""The least number of independent sensors that confirm an intent (ROE-01, ROE-10)."""
OUTWEIGHS = 2
"""The least ratio of weights at which several sensors prevail over contradicting ones."""
WITHDRAWN_S = 10.0
"""If a sensor detects no noncombatants this many seconds after its last suspicion of any, the
suspicion ends."""
FORGOTTEN_S = 60.0
"""If another sensor detects no noncombatants this many seconds after the last suspicion of any, the
suspicion ends too."""
_CONTRARY: Mapping[Identity, tuple[IdentityClaim, ...]] = {
    "authorized": ("unauthorized", "hostile"),
    "unauthorized": ("authorized",),
}
_POSITION_DOUBT_M = 5.0
"""The largest error of a reported position that the station may fail to notice
(`sim/sensing/integrity.py`)."""
_CONTACT_MPS = 20.0
"""The speed of the fastest contact; it limits the distance moved since another sensor's
detection."""
_SIGMAS = 3.0


def learn(  # noqa: PLR0917 - a statement: its sensor, its contact and its time
    terrain: Terrain, scene: Scene, file: TrackFile, sensor: str, stamp: int, detection: Detection
) -> None:
    """Store the statement of `sensor` at tick `stamp` on identity, intent and noncombatants.

    A statement without a position, or about a place beyond the sensor's reach, is ignored.
    """
    place = _place(terrain, scene, sensor, stamp)
    if place is None or detection.position is None:
        return
    if math.dist(place.at, detection.position) > place.reach_m:
        return
    # Markings and lights do not change: one detection is enough, and nothing withdraws it.
    file.emergency = file.emergency or detection.emergency
    before = _statement(terrain, file, sensor)
    now = before
    identifies = detection.identity != "unknown" and stamp >= before.identity_tick
    if identifies and not _is_elsewhere(terrain, file, sensor, stamp, place, detection.identity):
        now = replace(now, identity=detection.identity, identity_tick=stamp)
    if detection.opinion != "unknown" and stamp >= before.opinion_tick:
        now = replace(now, opinion=detection.opinion, opinion_tick=stamp)
    if detection.noncombatants:
        now = replace(now, suspected_tick=max(stamp, before.suspected_tick))
    elif any(statement.suspected_tick >= 0 for statement in file.statements):
        gap_m = max(math.dist(place.at, at) for at in (detection.position, file.position))
        if gap_m <= place.close_m:
            now = replace(now, clear_tick=max(stamp, before.clear_tick))
    if now != before:
        others = (statement for statement in file.statements if statement.sensor != sensor)
        file.statements = tuple(sorted((*others, now), key=lambda statement: statement.sensor))


def identity_of(file: TrackFile) -> Identity:
    """Return the identity that the statements support, unknown if they contradict each other."""
    if file.identified != "unknown":
        return file.identified
    claims = _claims(file)
    for identity, contrary in _CONTRARY.items():
        agree = [
            statement.weight
            for statement in file.statements
            if claims.get(statement.sensor) == identity
        ]
        against = sum(
            statement.weight
            for statement in file.statements
            if claims.get(statement.sensor) in contrary
        )
        enough = sum(agree) >= max(NEEDED_WEIGHT, OUTWEIGHS * against)
        if enough and (len(agree) > 1 or not against):
            return identity
    return "unknown"


def disputed_claims(file: TrackFile) -> dict[str, IdentityClaim]:
    """Return the identity claims by sensor if they contradict each other, else an empty dict."""
    claims = _claims(file)
    return dict(sorted(claims.items())) if len(set(claims.values())) > 1 else {}


def intent_of(file: TrackFile) -> Intent:
    """Return the intent that the sensors' opinions confirm.

    A hostile intent needs two independent sensors. A benign intent also needs two, or the only
    sensor that identified the contact, and no sensor may have a hostile opinion.
    """
    hostile = len(hostile_by(file))
    if hostile >= TWO_SENSORS:
        return "hostile"
    if hostile:
        return "unknown"
    benign = [statement for statement in file.statements if statement.opinion == "benign"]
    if len(benign) >= TWO_SENSORS:
        return "benign"
    identifiers = [statement for statement in file.statements if statement.identity != "unknown"]
    identified = identity_of(file) != "unknown"
    if identified and benign and identifiers in (benign, []):
        return "benign"
    return file.confirmed


def hostile_by(file: TrackFile) -> tuple[str, ...]:
    """Return the sensors with a hostile opinion of the contact, sorted."""
    return tuple(
        statement.sensor for statement in file.statements if statement.opinion == "hostile"
    )


def suspects_noncombatants(terrain: Terrain, file: TrackFile) -> bool:
    """Return whether noncombatants are suspected (ROE-08).

    A suspicion ends if a sensor has the contact close by and detects no noncombatants. If it is the
    sensor that had the suspicion, WITHDRAWN_S must have passed since it last reported the
    suspicion; if it is another sensor, FORGOTTEN_S.
    """
    if file.suspected:
        return True
    withdrawn = WITHDRAWN_S / terrain.world.dt_s
    forgotten = FORGOTTEN_S / terrain.world.dt_s
    latest_clear = max((statement.clear_tick for statement in file.statements), default=-1)
    return any(
        statement.suspected_tick >= 0
        and statement.clear_tick - statement.suspected_tick < withdrawn
        and latest_clear - statement.suspected_tick < forgotten
        for statement in file.statements
    )


def weight_of(terrain: Terrain, sensor: str) -> int:
    """Return the weight of a sensor's statements, which depends on its kind."""
    asset = terrain.world.assets.get(sensor)
    return ROBOT_WEIGHT if asset is not None and asset.kind == "robot" else OTHER_WEIGHT


def _claims(file: TrackFile) -> Mapping[str, IdentityClaim]:
    """Return the identity claim of each sensor.

    If a sensor claims `authorized`, a hostile opinion of a sensor that has not identified the
    contact counts as a claim against it.
    """
    claims: dict[str, IdentityClaim] = {}
    for statement in file.statements:
        if statement.identity != "unknown":
            claims[statement.sensor] = statement.identity
    if "authorized" in claims.values():
        for sensor in hostile_by(file):
            claims.setdefault(sensor, "hostile")
    return claims


def _statement(terrain: Terrain, file: TrackFile, sensor: str) -> Statement:
    """Return the present statement of a sensor, or an empty statement."""
    statement = next((entry for entry in file.statements if entry.sensor == sensor), None)
    return statement or Statement(sensor, weight_of(terrain, sensor))


class _SensorReach(NamedTuple):
    """A sensor's place, its reach, and the distance within which a contact is certainly close."""

    at: Point
    reach_m: float
    close_m: float


def _place(terrain: Terrain, scene: Scene, sensor: str, stamp: int) -> _SensorReach | None:
    """Return the known place and reach of a sensor at tick `stamp`; a camera never moves.

    Returns None for an asset whose latest report is too old.
    """
    world = terrain.world
    camera, asset = world.cameras.get(sensor), world.assets.get(sensor)
    if camera is not None:
        return _seeing(world, camera, camera.at, 0.0)
    record = scene.station.heard.get(sensor)
    if asset is None or record is None:
        return None
    since_s = abs(stamp - record.stamp) * world.dt_s
    if since_s > world.stale_s and not scene.ideal:
        return None
    platform = world.platforms[asset.kind]
    return _seeing(world, platform, record.telemetry.like.position, platform.speed_mps * since_s)


def _seeing(world: World, spec: Sensing, at: Point, moved_m: float) -> _SensorReach:
    noise_m = _SIGMAS * spec.position_noise_m
    reach_m = spec.sensor_range_m + noise_m + _POSITION_DOUBT_M + moved_m
    return _SensorReach(at, reach_m, CLOSE_STANDOFFS * world.standoff_m - noise_m - moved_m)


def _is_elsewhere(  # noqa: PLR0917 - a claim: its sensor, its contact, its place and its time
    terrain: Terrain,
    file: TrackFile,
    sensor: str,
    stamp: int,
    place: _SensorReach,
    identity: Identity,
) -> bool:
    """Return whether other sensors detect the contact beyond the reach of `sensor` at `place`.

    A tie is decided for safety: it excludes a claim of `authorized` and accepts one of
    `unauthorized`, so that one sensor with false positions cannot suppress a warning.
    """
    dt_s, here = terrain.world.dt_s, 0 if identity == "authorized" else 1
    there = 0
    for sighting in file.seen:
        age_s = abs(stamp - sighting.tick) * dt_s
        if sighting.sensor != sensor and age_s <= terrain.world.stale_s:
            in_reach = math.dist(place.at, sighting.at) <= place.reach_m + _CONTACT_MPS * age_s
            here, there = (here + 1, there) if in_reach else (here, there + 1)
    return there > here
