"""Puts tracks into the picture's form: as the station knows them, and as they truly are."""

import math

from pa_console.schema.telemetry import Track
from pa_console.sim.sensing import evidence
from pa_console.sim.sensing.tracker import gap_to_gate
from pa_console.sim.state.scene import Scene
from pa_console.sim.state.sensing_state import ContactState, TrackFile
from pa_console.sim.worlds.terrain import Terrain

SEEN_PERIODS = 3
"""A detection counts as present for this number of telemetry periods."""


def known_track(terrain: Terrain, scene: Scene, file: TrackFile) -> Track:
    """Return a track as its file has it; `position` is that of the last detection."""
    world = terrain.world
    recent = scene.tick - round(SEEN_PERIODS * world.telemetry_period_s / world.dt_s)
    seen_by = tuple(sorted(one.sensor for one in file.seen if one.tick >= recent))
    age_s = terrain.seconds(scene.tick - file.tick)
    speed = 0.0 if file.status == "stopped" else math.hypot(file.vx, file.vy)
    return Track(
        id=file.id,
        kind=file.kind,
        gate=file.gate,
        position=_rounded(file.x, file.y),
        heading_deg=round(math.degrees(file.heading), 1),
        speed_mps=round(speed, 3),
        distance_m=round(gap_to_gate(terrain, file), 3),
        identity=evidence.identity_of(file),
        intent=evidence.intent_of(file),
        status=file.status,
        observed_by=tuple(s for s in seen_by if s in world.assets and _flies(terrain, s)),
        observed=file.observed,
        warned=file.warned_tick is not None,
        stamp_s=terrain.seconds(file.tick),
        first_seen_s=terrain.seconds(file.first_tick),
        stale=age_s > world.stale_s,
        uncertainty_m=round(file.sigma_m + speed * age_s, 3),
        seen_by=seen_by,
        hostile_by=evidence.hostile_by(file),
        noncombatants=evidence.suspects_noncombatants(terrain, file),
        defiant=file.defiant,
        identity_claims=evidence.disputed_claims(file),
    )


def _flies(terrain: Terrain, asset: str) -> bool:
    return terrain.world.assets[asset].kind == "uav"


def true_track(terrain: Terrain, scene: Scene, contact: ContactState) -> Track:
    """Return a contact exactly, under its track's id if it has one; who sees it is as known."""
    file = scene.sensing.files.get(contact.id)
    known = None if file is None else known_track(terrain, scene, file)
    now_s = terrain.seconds(scene.tick)
    return Track(
        id=contact.id if known is None else known.id,
        kind=contact.kind,
        gate=contact.gate,
        position=_rounded(contact.x, contact.y),
        heading_deg=round(math.degrees(contact.heading), 1),
        speed_mps=round(contact.speed, 3),
        distance_m=round(math.dist(contact.position, terrain.world.frames[contact.gate].at), 3),
        identity=contact.identity,
        intent=contact.intent,
        status=contact.status,
        observed_by=known.observed_by if known else (),
        observed=known.observed if known else False,
        warned=contact.warned_tick is not None,
        stamp_s=now_s,
        first_seen_s=known.first_seen_s if known else now_s,
        seen_by=known.seen_by if known else (),
        hostile_by=known.hostile_by if known else (),
        noncombatants=contact.noncombatants,
        defiant=_defies(contact),
        identity_claims=known.identity_claims if known else {},
    )


def _defies(contact: ContactState) -> bool:
    """Return whether a contact truly goes on although it was warned."""
    return (
        contact.warned_tick is not None
        and contact.when_warned == "go_on"
        and (contact.speed > 0.0 or contact.status == "inside")
    )


def _rounded(x: float, y: float) -> tuple[float, float]:
    return (round(x, 3), round(y, 3))
