"""Incidents about contacts, sensors and weather (paper, Section IV-C: what happens by itself)."""

from pa_console.schema.incident import (
    ClearTracks,
    FalseContact,
    Incident,
    RevealTrack,
    SensorFault,
    SetWeather,
    SpawnTrack,
)
from pa_console.sim.contacts import contacts
from pa_console.sim.state.scene import Scene
from pa_console.sim.state.sensing_state import Phantom
from pa_console.sim.worlds.terrain import Terrain


def apply(terrain: Terrain, scene: Scene, incident: Incident) -> bool:
    """Make an incident about contacts, sensors or weather true; return whether it was one.

    Its gate and sensor exist; raises ValueError naming the known contacts for an unknown one.
    """
    state = scene.sensing
    match incident:
        case SpawnTrack():
            contacts.spawn(terrain, scene, incident)
        case ClearTracks(gate=gate):
            _clear(terrain, scene, gate)
        case RevealTrack():
            contacts.turn(scene, incident)
        case FalseContact(gate=gate, seconds=seconds):
            _imagine(terrain, scene, gate, seconds)
        case SensorFault(sensor=sensor, works=works):
            broken = {*state.broken} - {sensor} if works else {*state.broken, sensor}
            state.broken = tuple(sorted(broken))
        case SetWeather(weather=now):
            state.weather = now
        case _:
            return False
    return True


def _clear(terrain: Terrain, scene: Scene, gate: str) -> None:
    """Take every contact, phantom and track of `gate` away, detections under way included."""
    state = scene.sensing
    there = {c.id for c in state.contacts.values() if c.gate == gate}
    tracked = {file.contact for file in state.files.values() if file.gate == gate}
    for contact in there:
        contacts.remove(scene, contact)
    lanes = terrain.lanes_to(gate)
    there |= {phantom.id for phantom in state.phantoms if phantom.lane in lanes}
    state.phantoms = tuple(p for p in state.phantoms if p.lane not in lanes)
    for contact in there | tracked:
        state.files.pop(contact, None)
    state.cleared = tuple(sorted({*state.cleared} | there))


def _imagine(terrain: Terrain, scene: Scene, gate: str, seconds: float) -> None:
    """Let one sensor at `gate` report a phantom: a working camera, else an asset."""
    state = scene.sensing
    lane = contacts.pick_lane(terrain, scene, gate)
    watching = [name for name, camera in terrain.world.cameras.items() if camera.gate == gate]
    watching += [a.id for a in scene.assets.values() if a.post == gate and not a.down]
    able = [name for name in watching if name not in state.broken]
    if able:
        state.spawned += 1
        until = scene.tick + round(seconds / terrain.world.dt_s)
        phantom = Phantom(f"Phantom_{state.spawned:02d}", lane, able[0], scene.tick, until)
        state.phantoms = (*state.phantoms, phantom)
