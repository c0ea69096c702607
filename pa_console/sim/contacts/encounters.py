"""Ground robots and contacts: identifying and warning at a gate (WF-01, ROE-02, CAP-03).

What a robot does here rests on its proximity sensors, which see the truth near it whatever the
weather; the station learns of it by the robot's reports. The track ids in its answers are those
that the station has given.
"""

import math
from dataclasses import replace
from typing import Literal

from pa_console.schema.command import Verb
from pa_console.sim.sensing.evidence import identity_of
from pa_console.sim.sensing.tracker import name_of
from pa_console.sim.state.scene import AssetState, Scene
from pa_console.sim.state.sensing_state import ContactState, Finding
from pa_console.sim.worlds.terrain import Terrain

IDENTIFY_S = 4.0
WARN_S = 3.0

Ending = tuple[Literal["done", "failed"] | None, str]


def attend(terrain: Terrain, scene: Scene, asset: AssetState, verb: Verb, gate: str) -> Ending:
    """Advance an `identify` or `warn` of an asset that stands at `gate`; None means not yet.

    It fails at once when nothing is there or on its way, waits for one on its way to come within
    sensor range, and then needs a few seconds with it. What is found out is the robot's own
    opinion: that a contact is hostile takes another sensor to confirm (ROE-01).
    """
    contact = _choose(scene, asset, verb, gate)
    if contact is None:
        return "failed", f"no track at {gate}"
    gap_m = math.dist(contact.position, asset.position)
    if gap_m > terrain.world.platforms[asset.kind].sensor_range_m:
        asset.dwell = 0
        return None, ""
    asset.dwell += 1
    needed = IDENTIFY_S if verb == "identify" else WARN_S
    if asset.dwell * terrain.world.dt_s < needed:
        return None, ""
    if verb == "warn" and contact.warned_tick is None:
        contact.warned_tick = scene.tick
    _note(scene, asset, contact, verb)
    name = called(scene, contact)
    if verb == "warn":
        return "done", f"warned {name}"
    return "done", f"{name} is {contact.identity}, looks {_looks(contact)}"


def called(scene: Scene, contact: ContactState) -> str:
    """Return the track id of a contact, or its kind if the station does not track it."""
    return name_of(scene, contact.id) or f"a {contact.kind}"


def _looks(contact: ContactState) -> str:
    return "undecided" if contact.intent == "unknown" else contact.intent


def _note(scene: Scene, asset: AssetState, contact: ContactState, verb: str) -> None:
    """Keep the asset's finding, which goes out with its reports."""
    findings, key = scene.sensing.findings, (asset.id, contact.id)
    before = findings.get(key, Finding())
    if verb == "identify":
        findings[key] = Finding(contact.identity, contact.intent, before.warned_tick, scene.tick)
    else:
        findings[key] = replace(before, warned_tick=contact.warned_tick)


def _choose(scene: Scene, asset: AssetState, verb: str, gate: str) -> ContactState | None:
    """Return the contact to attend to at `gate`: first one that still needs it, then the nearest.

    A contact counts as identified if it does at the station, which gave the order.
    """
    here = [c for c in scene.contacts.values() if c.gate == gate and c.status != "leaving"]

    def rank(contact: ContactState) -> tuple[bool, float, str]:
        file = scene.sensing.files.get(contact.id)
        identified = file is not None and identity_of(file) != "unknown"
        done = identified if verb == "identify" else contact.warned_tick is not None
        return done, math.dist(contact.position, asset.position), contact.id

    return min(here, key=rank, default=None)
