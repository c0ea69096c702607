"""The exact truth of a scene, for scorers and tests only.

Besides each contact's true state, it has the sensors' true findings about it: whether a ground
robot has identified it, which UAVs have it in range now, and how old its last detection is.
"""

import math
from dataclasses import dataclass

from pa_console.schema.base import Point
from pa_console.schema.telemetry import (
    AssetTelemetry,
    GateCover,
    Identity,
    Intent,
    Picture,
    Track,
    TrackStatus,
)
from pa_console.sim import radio
from pa_console.sim.scene import AssetState, Scene
from pa_console.sim.sensing.evidence import intent_of
from pa_console.sim.sensing.sensors import WEATHER
from pa_console.sim.sensing.tracker import known_track
from pa_console.sim.sensing_state import ContactKind, ContactState
from pa_console.sim.telemetry import cameras_known, report_of, rounded, where
from pa_console.sim.worlds.terrain import Terrain


def truth(terrain: Terrain, scene: Scene) -> Picture:
    """Return the exact state as a picture, with the true cover of gates."""
    assets: dict[str, AssetTelemetry] = {}
    by: dict[str, list[str]] = {gate: [] for gate in terrain.world.gates}
    for asset in scene.assets.values():
        comms = radio.quality(terrain.world, scene, asset)
        at = where(terrain, asset)
        exact: dict[str, object] = {
            "comms": comms,
            "at": at,
            "position": rounded(asset.position),
            "available": not asset.down and comms != "lost",
        }
        if comms != "ok" and not asset.down:
            exact["status"] = "degraded"
        assets[asset.id] = (
            report_of(terrain, scene.tick, asset).telemetry().model_copy(update=exact)
        )
        if at in by and at == asset.post and not asset.down:
            by[at].append(asset.id)
    return Picture(
        tick=scene.tick,
        time_s=terrain.seconds(scene.tick),
        assets=assets,
        tracks=true_tracks(terrain, scene),
        gates={
            gate: GateCover(
                covered=bool(names),
                by=tuple(names),
                uncovered_s=0.0
                if names
                else terrain.seconds(scene.tick - scene.covered_tick.get(gate, 0)),
            )
            for gate, names in by.items()
        },
        cameras=cameras_known(terrain, scene),
        weather=scene.sensing.weather,
    )


def true_tracks(terrain: Terrain, scene: Scene) -> dict[str, Track]:
    """Return the exact contacts, by track id or, if untracked, by contact id."""
    tracks = (_true_track(terrain, scene, contact) for contact in scene.contacts.values())
    return {track.id: track for track in tracks}


def _true_track(terrain: Terrain, scene: Scene, contact: ContactState) -> Track:
    """Return the exact contact as a track; `observed_by` and `seen_by` come from the station."""
    file = scene.sensing.files.get(contact.id)
    track = None if file is None else known_track(terrain, scene, file)
    now_s = terrain.seconds(scene.tick)
    return Track(
        id=contact.id if track is None else track.id,
        kind=contact.kind,
        gate=contact.gate,
        position=rounded(contact.position),
        heading_deg=round(math.degrees(contact.heading), 1),
        speed_mps=round(contact.speed, 3),
        distance_m=round(math.dist(contact.position, terrain.world.frames[contact.gate].at), 3),
        identity=contact.identity,
        intent=contact.intent,
        status=contact.status,
        observed_by=track.observed_by if track else (),
        observed=track.observed if track else False,
        warned=contact.warned_tick is not None,
        stamp_s=now_s,
        first_seen_s=track.first_seen_s if track else now_s,
        seen_by=track.seen_by if track else (),
        hostile_by=track.hostile_by if track else (),
        noncombatants=contact.noncombatants,
        emergency=contact.emergency,
        defiant=_defies(contact),
        identity_claims=track.identity_claims if track else {},
    )


def _defies(contact: ContactState) -> bool:
    """Return whether a contact really continues although it was warned."""
    return (
        contact.warned_tick is not None
        and contact.when_warned == "go_on"
        and (contact.speed > 0.0 or contact.status == "inside")
    )


@dataclass(frozen=True, slots=True)
class TrueContact:
    """The true state of a contact; `id` never changes, `track` is '' if it is not tracked.

    `emergency` is True once a sensor has recognized a true emergency vehicle. `confirmed` is the
    intent that the sensors' evidence supports (ROE-01, ROE-10). `watched_by` has the working UAVs
    with the contact in range and in view. `unseen_s` is the time since a sensor last detected the
    contact, or None if the contact is not tracked.
    """

    id: str
    track: str
    kind: ContactKind
    gate: str
    position: Point
    status: TrackStatus
    identity: Identity
    intent: Intent
    noncombatants: bool
    emergency: bool
    identified: bool
    confirmed: Intent
    observed: bool
    warned: bool
    watched_by: tuple[str, ...]
    unseen_s: float | None


def true_contacts(terrain: Terrain, scene: Scene) -> tuple[TrueContact, ...]:
    """Return every contact that has not left, in the order of appearance."""
    if not scene.contacts:
        return ()
    eyes = [
        asset
        for asset in scene.assets.values()
        if asset.kind == "uav" and not asset.down and asset.id not in scene.sensing.broken
    ]
    return tuple(_exact(terrain, scene, contact, eyes) for contact in scene.contacts.values())


def _exact(
    terrain: Terrain, scene: Scene, contact: ContactState, eyes: list[AssetState]
) -> TrueContact:
    file = scene.sensing.files.get(contact.id)
    return TrueContact(
        id=contact.id,
        track=file.id if file is not None else "",
        kind=contact.kind,
        gate=contact.gate,
        position=contact.position,
        status=contact.status,
        identity=contact.identity,
        intent=contact.intent,
        noncombatants=contact.noncombatants,
        emergency=contact.emergency and file is not None and file.emergency,
        identified=any(
            finding.identity != "unknown"
            for (_, about), finding in scene.sensing.findings.items()
            if about == contact.id
        ),
        confirmed=intent_of(file) if file is not None else "unknown",
        observed=file is not None and file.observed,
        warned=contact.warned_tick is not None,
        watched_by=tuple(asset.id for asset in eyes if _in_view(terrain, scene, asset, contact)),
        unseen_s=None if file is None else terrain.seconds(scene.tick - file.tick),
    )


def _in_view(terrain: Terrain, scene: Scene, asset: AssetState, contact: ContactState) -> bool:
    """Return whether a UAV's sensor reaches the contact in this weather; walls do not matter."""
    platform = terrain.world.platforms[asset.kind]
    reach = platform.sensor_range_m * WEATHER[scene.sensing.weather][0]
    if math.dist(asset.position, contact.position) > reach:
        return False
    bearing = math.atan2(contact.y - asset.y, contact.x - asset.x)
    off = abs(math.remainder(bearing - asset.heading, math.tau))
    return off <= math.radians(platform.field_of_view_deg / 2) + 1e-9
