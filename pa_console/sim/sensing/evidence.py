"""Evidence about a contact: what each sensor says of it, and what the station concludes from that.

A statement counts only if the sensor had the contact in reach when it made it, by what the station
knows of both. A sensor has one say: its latest statement replaces its earlier one. Sources are
weighted by kind, and those that contradict each other leave an identity unknown, unless several
agree against one.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Identity, IdentityClaim, Intent
from pa_console.schema.world import Sensing, World
from pa_console.sim.sensing.sensors import CLOSE_STANDOFFS
from pa_console.sim.state.scene import Scene
from pa_console.sim.state.sensing_state import Detection, Statement, TrackFile
from pa_console.sim.worlds.terrain import Terrain

ROBOT_WEIGHT, OTHER_WEIGHT = 2, 1
"""A ground robot has dealt with the contact (`identify`); other sensors have only looked at it."""
NEEDED_WEIGHT = 2
"""Identity takes so much weight: one ground robot, or two other sensors."""
TWO_SENSORS = 2
"""So many independent sensors must agree before an intent is confirmed (ROE-01, ROE-10)."""
OUTWEIGHS = 2
"""Sensors that are contradicted prevail if they are two or more, with so many times the weight."""
WITHDRAWN_S = 10.0
"""A sensor no longer suspects noncombatants if it still does not so long after it last did."""
FORGOTTEN_S = 60.0
"""So long after a suspicion was last stated, another sensor that sees none may end it."""
_CONTRARY: Mapping[Identity, tuple[IdentityClaim, ...]] = {
    "authorized": ("unauthorized", "hostile"),
    "unauthorized": ("authorized",),
}
_POSITION_DOUBT_M = 5.0
"""A reported position may be so far off before the station notices (`picture/integrity.py`)."""
_CONTACT_MPS = 20.0
"""A contact may have gone so fast since another sensor detected it."""
_SIGMAS = 3.0


def learn(  # noqa: PLR0917 - which sensor says what of which contact, and when
    terrain: Terrain, scene: Scene, file: TrackFile, sensor: str, stamp: int, heard: Detection
) -> None:
    """Keep what `sensor` says of a contact's identity, intent and noncombatants at tick `stamp`.

    A statement without a position, or about a place that the sensor cannot see from where it is,
    counts for nothing.
    """
    place = _place(terrain, scene, sensor, stamp)
    if place is None or heard.position is None:
        return
    if math.dist(place.at, heard.position) > place.reach_m:
        return
    said = _statement(terrain, file, sensor)
    now = said
    identifies = heard.identity != "unknown" and stamp >= said.identity_tick
    if identifies and not _is_elsewhere(terrain, file, sensor, stamp, place, heard.identity):
        now = replace(now, identity=heard.identity, identity_tick=stamp)
    if heard.opinion != "unknown" and stamp >= said.opinion_tick:
        now = replace(now, opinion=heard.opinion, opinion_tick=stamp)
    if heard.noncombatants:
        now = replace(now, suspected_tick=max(stamp, said.suspected_tick))
    elif any(one.suspected_tick >= 0 for one in file.statements):
        gap_m = max(math.dist(place.at, at) for at in (heard.position, file.position))
        if gap_m <= place.close_m:
            now = replace(now, clear_tick=max(stamp, said.clear_tick))
    if now != said:
        others = (one for one in file.statements if one.sensor != sensor)
        file.statements = tuple(sorted((*others, now), key=lambda one: one.sensor))


def identity_of(file: TrackFile) -> Identity:
    """Return the identity that the sensors' statements support, unknown if they contradict."""
    if file.identified != "unknown":
        return file.identified
    claims = _claims(file)
    for identity, contrary in _CONTRARY.items():
        agree = [one.weight for one in file.statements if claims.get(one.sensor) == identity]
        against = sum(one.weight for one in file.statements if claims.get(one.sensor) in contrary)
        enough = sum(agree) >= max(NEEDED_WEIGHT, OUTWEIGHS * against)
        if enough and (len(agree) > 1 or not against):
            return identity
    return "unknown"


def disputed_claims(file: TrackFile) -> dict[str, IdentityClaim]:
    """Return what each source says of the identity if they contradict each other, else nothing."""
    claims = _claims(file)
    return dict(sorted(claims.items())) if len(set(claims.values())) > 1 else {}


def intent_of(file: TrackFile) -> Intent:
    """Return the intent that the sensors' opinions confirm.

    Hostile takes two independent sensors. Benign takes two as well, or the only one that identified
    the contact, and no sensor that says hostile.
    """
    hostile = len(hostile_by(file))
    if hostile >= TWO_SENSORS:
        return "hostile"
    if hostile:
        return "unknown"
    benign = [one for one in file.statements if one.opinion == "benign"]
    if len(benign) >= TWO_SENSORS:
        return "benign"
    identifiers = [one for one in file.statements if one.identity != "unknown"]
    identified = identity_of(file) != "unknown"
    if identified and benign and identifiers in (benign, []):
        return "benign"
    return file.confirmed


def hostile_by(file: TrackFile) -> tuple[str, ...]:
    """Return the sensors that hold the contact for hostile, sorted."""
    return tuple(one.sensor for one in file.statements if one.opinion == "hostile")


def suspects_noncombatants(terrain: Terrain, file: TrackFile) -> bool:
    """Return whether noncombatants are suspected (ROE-08).

    A suspicion ends when its sensor has them close by for a while without it, or when another one
    has, long after it was last stated.
    """
    if file.suspected:
        return True
    withdrawn = WITHDRAWN_S / terrain.world.dt_s
    forgotten = FORGOTTEN_S / terrain.world.dt_s
    latest_clear = max((one.clear_tick for one in file.statements), default=-1)
    return any(
        one.suspected_tick >= 0
        and one.clear_tick - one.suspected_tick < withdrawn
        and latest_clear - one.suspected_tick < forgotten
        for one in file.statements
    )


def weight_of(terrain: Terrain, sensor: str) -> int:
    """Return how much the word of `sensor` counts, by its kind."""
    asset = terrain.world.assets.get(sensor)
    return ROBOT_WEIGHT if asset is not None and asset.kind == "robot" else OTHER_WEIGHT


def _claims(file: TrackFile) -> Mapping[str, IdentityClaim]:
    """Return what each sensor says of the identity.

    One that holds the contact for hostile and has not identified it speaks against a contact that
    others say is authorized; it takes no side as long as none of them does.
    """
    claims: dict[str, IdentityClaim] = {}
    for one in file.statements:
        if one.identity != "unknown":
            claims[one.sensor] = one.identity
    if "authorized" in claims.values():
        for sensor in hostile_by(file):
            claims.setdefault(sensor, "hostile")
    return claims


def _statement(terrain: Terrain, file: TrackFile, sensor: str) -> Statement:
    """Return what a sensor has said so far, or that it has said nothing."""
    said = next((one for one in file.statements if one.sensor == sensor), None)
    return said or Statement(sensor, weight_of(terrain, sensor))


class _Place(NamedTuple):
    """Where a sensor is, how far it may see from there, and how near it surely sees well."""

    at: Point
    reach_m: float
    close_m: float


def _place(terrain: Terrain, scene: Scene, sensor: str, stamp: int) -> _Place | None:
    """Return where a sensor was at tick `stamp`, as the station knows it; a camera never moves.

    None of an asset that had not reported its position lately.
    """
    world = terrain.world
    camera, asset = world.cameras.get(sensor), world.assets.get(sensor)
    if camera is not None:
        return _seeing(world, camera, camera.at, 0.0)
    heard = scene.station.heard.get(sensor)
    if asset is None or heard is None:
        return None
    since_s = abs(stamp - heard.stamp) * world.dt_s
    if since_s > world.stale_s and not scene.ideal:
        return None
    platform = world.platforms[asset.kind]
    return _seeing(world, platform, heard.telemetry.like.position, platform.speed_mps * since_s)


def _seeing(world: World, spec: Sensing, at: Point, moved_m: float) -> _Place:
    noise_m = _SIGMAS * spec.position_noise_m
    reach_m = spec.sensor_range_m + noise_m + _POSITION_DOUBT_M + moved_m
    return _Place(at, reach_m, CLOSE_STANDOFFS * world.standoff_m - noise_m - moved_m)


def _is_elsewhere(  # noqa: PLR0917 - who says what of which contact, from where and when
    terrain: Terrain, file: TrackFile, sensor: str, stamp: int, place: _Place, identity: Identity
) -> bool:
    """Return whether other sensors have the contact where `sensor`, which is at `place`, sees none.

    If as many have it there as not, what would make a contact harmless does not count, and what
    would not does: one sensor that lies about places silences none that says unauthorized.
    """
    dt_s, here = terrain.world.dt_s, 0 if identity == "authorized" else 1
    there = 0
    for one in file.seen:
        age_s = abs(stamp - one.tick) * dt_s
        if one.sensor != sensor and age_s <= terrain.world.stale_s:
            in_reach = math.dist(place.at, one.at) <= place.reach_m + _CONTACT_MPS * age_s
            here, there = (here + 1, there) if in_reach else (here, there + 1)
    return there > here
