"""The truth about vehicles and persons: how they appear, change their mind, and are gone."""

from pa_console.schema.incident import RevealTrack, SpawnTrack
from pa_console.sim.lanes import QUEUE_GAP_M
from pa_console.sim.sensing_state import ContactState
from pa_console.sim.state import Scene
from pa_console.sim.terrain import Terrain


def spawn(terrain: Terrain, scene: Scene, incident: SpawnTrack) -> ContactState:
    """Put a new contact on a lane of its gate, behind whatever is already there.

    It starts `distance_m` from the gate, but never nearer than where contacts wait. Raises
    ValueError when no lane leads to the gate.
    """
    lane = pick_lane(terrain, scene, incident.gate)
    line = terrain.lanes[lane]
    start = 0.0 if incident.distance_m is None else line.first_within(incident.distance_m)
    state = scene.sensing
    ahead = [
        c.travelled - QUEUE_GAP_M for c in state.contacts.values() if c.lane == lane and c.on_lane
    ]
    state.spawned += 1
    travelled = max(0.0, min([start, line.waiting_m, *ahead]))
    (x, y), heading = line.locate(travelled)
    contact = ContactState(
        id=f"Contact_{state.spawned:02d}",
        kind=incident.track,
        gate=incident.gate,
        lane=lane,
        travelled=travelled,
        x=x,
        y=y,
        heading=heading,
        cruise_mps=incident.speed_mps,
        identity=incident.identity,
        intent=incident.intent,
        when_warned=incident.when_warned,
        noncombatants=incident.noncombatants,
        name=incident.name,
    )
    state.contacts[contact.id] = contact
    if incident.name is not None:
        state.named[incident.name] = contact.id
    return contact


def pick_lane(terrain: Terrain, scene: Scene, gate: str) -> str:
    """Return a lane that leads to `gate`, drawn if there are several; ValueError if none does."""
    lanes = terrain.lanes_to(gate)
    if not lanes:
        known = ", ".join(sorted({lane.gate for lane in terrain.world.lanes.values()})) or "none"
        raise ValueError(f"no lane leads to {gate!r}; gates with a lane: {known}")
    return lanes[0] if len(lanes) == 1 else scene.rng.choice(lanes)


def turn(scene: Scene, incident: RevealTrack) -> None:
    """Change the truth behind a contact that a script named; one that is gone stays gone.

    Sensors must watch it anew before they see a changed intent. Raises ValueError when nothing of
    this name was ever spawned.
    """
    state = scene.sensing
    if incident.track not in state.named:
        known = ", ".join(state.named) or "none"
        raise ValueError(f"there is no contact named {incident.track!r}; known: {known}")
    contact = state.contacts.get(state.named[incident.track])
    if contact is None:
        return
    contact.identity = incident.identity or contact.identity
    contact.when_warned = incident.when_warned or contact.when_warned
    if incident.intent is not None and incident.intent != contact.intent:
        contact.intent = incident.intent
        state.watched = {key: n for key, n in state.watched.items() if key[1] != contact.id}


def remove(scene: Scene, contact_id: str) -> None:
    """Take a contact out of the truth, and out of what sensors have learned about those present."""
    state = scene.sensing
    del state.contacts[contact_id]
    state.watched = {key: n for key, n in state.watched.items() if key[1] != contact_id}
    state.findings = {key: f for key, f in state.findings.items() if key[1] != contact_id}
