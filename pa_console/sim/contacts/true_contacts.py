"""The exact truth about every vehicle and person, for scorers and tests; nothing else may see it.

Beside what a contact is, it says what our sensors have truly found out about it: whether a ground
robot has identified it, which UAVs have it in range now, how old the latest detection is.
"""

import math
from dataclasses import dataclass

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Identity, Intent, TrackStatus
from pa_console.sim.sensing.evidence import intent_of
from pa_console.sim.sensing.sensors import WEATHER
from pa_console.sim.state.scene import AssetState, Scene
from pa_console.sim.state.sensing_state import ContactKind, ContactState
from pa_console.sim.worlds.terrain import Terrain


@dataclass(frozen=True, slots=True)
class TrueContact:
    """A contact as it is; `id` never changes, `track` is '' while the station does not track it.

    `confirmed` is the intent that the sensors' evidence supports (ROE-01, ROE-10), `watched_by`
    names the working UAVs that have it within range and view, `unseen_s` is for how long no sensor
    has detected it (None: it is not tracked).
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
    identified: bool
    confirmed: Intent
    observed: bool
    warned: bool
    watched_by: tuple[str, ...]
    unseen_s: float | None


def true_contacts(terrain: Terrain, scene: Scene) -> tuple[TrueContact, ...]:
    """Return every contact that is there now, in the order of their appearance."""
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
    """Return whether a UAV's sensor reaches the contact in this weather; walls are no matter."""
    platform = terrain.world.platforms[asset.kind]
    reach = platform.sensor_range_m * WEATHER[scene.sensing.weather][0]
    if math.dist(asset.position, contact.position) > reach:
        return False
    bearing = math.atan2(contact.y - asset.y, contact.x - asset.x)
    off = abs(math.remainder(bearing - asset.heading, math.tau))
    return off <= math.radians(platform.field_of_view_deg / 2) + 1e-9
