"""The effects of incidents on a scene, and the times of a scenario's incidents."""

import math
import random
from dataclasses import replace

from pa_console.schema.incident import (
    After,
    AssetIs,
    ClearTracks,
    DegradeAsset,
    DriveByHand,
    FailAsset,
    FalseContact,
    GpsDrift,
    Incident,
    JamArea,
    ObstructWay,
    PlaceAsset,
    RestoreAsset,
    RevealTrack,
    Scenario,
    SensorFault,
    SetBattery,
    SetComms,
    SetRadio,
    SetWeather,
    SpawnTrack,
    SpoofTelemetry,
    TrackIs,
    WorkerFault,
    unknown_name,
)
from pa_console.schema.telemetry import Task
from pa_console.schema.world import Wall
from pa_console.sim import contacts, devices, radio
from pa_console.sim.physics import gap
from pa_console.sim.scene import AssetState, Drift, Scene, ScriptState, rouse
from pa_console.sim.sensing.evidence import identity_of
from pa_console.sim.sensing_state import Phantom
from pa_console.sim.worlds.terrain import Terrain

OBSTRUCTION_M = 0.8
"""The thickness of an obstruction, in metres."""

_TIME_NOISE_S = 1e-9


def apply(terrain: Terrain, scene: Scene, incident: Incident) -> None:
    """Apply `incident` to `scene`; raises ValueError, with the known names, for an unknown name."""
    _, problem = unknown_name(incident, terrain.world)
    if problem:
        raise ValueError(problem)
    match incident:
        case FailAsset(asset=name):
            _asset(terrain, scene, name).failed = True
        case RestoreAsset(asset=name):
            _restore(terrain, _asset(terrain, scene, name))
        case SetBattery(asset=name, percent=percent):
            _asset(terrain, scene, name).battery = percent
        case DegradeAsset(asset=name, speed_factor=factor):
            _asset(terrain, scene, name).speed_factor = factor
        case SetComms(asset=name, comms=comms):
            radio.set_comms(terrain.world, _asset(terrain, scene, name), comms)
        case SetRadio(asset=name):
            for asset_name in scene.assets if name is None else (name,):
                radio.set_radio(_asset(terrain, scene, asset_name), incident)
        case JamArea():
            radio.jam(terrain.world, scene, incident)
        case GpsDrift(asset=name, rate_mps=rate, heading_deg=heading_deg):
            heading = math.radians(heading_deg)
            drift = Drift(rate * math.cos(heading), rate * math.sin(heading), scene.tick)
            _asset(terrain, scene, name).drift = drift if rate > 0.0 else None
        case SpoofTelemetry(asset=name, frame=frame):
            _asset(terrain, scene, name).spoofed = frame
        case DriveByHand(asset=name, ends=True):
            devices.let_go(terrain, _asset(terrain, scene, name))
        case DriveByHand(asset=name, frame=frame):
            devices.drive_by_hand(terrain, scene, _asset(terrain, scene, name), frame)
        case PlaceAsset(asset=name, frame=frame):
            place(terrain, scene, _asset(terrain, scene, name), frame)
            _carried(scene, name)
        case _:
            _apply_to_surroundings(terrain, scene, incident)


def place(terrain: Terrain, scene: Scene, asset: AssetState, frame: str) -> None:
    """Move `asset` to a free place at `frame`, its new post; raises ValueError if there is none."""
    taken = [
        point
        for other in scene.assets.values()
        if other is not asset and (other.kind == "uav") == (asset.kind == "uav")
        for point in (other.position, other.station)
    ]
    point = terrain.free_place(frame, asset.kind, taken)
    if point is None:
        room = len(terrain.places(frame, asset.kind))
        raise ValueError(f"no free place for {asset.id} at {frame!r}, which has room for {room}")
    asset.x, asset.y = point
    asset.post = frame
    asset.stop("none" if asset.down else watch_task(terrain, asset.kind, frame))


def watch_task(terrain: Terrain, kind: str, frame: str) -> Task:
    """Return the task of an asset posted at `frame`: a UAV at a gate observes it."""
    return "observing" if kind == "uav" and frame in terrain.world.gates else "idle"


def _restore(terrain: Terrain, asset: AssetState) -> None:
    """Make the asset work again where it is; an empty battery is replaced by a full one.

    The asset's post becomes the frame that it is at, if any.
    """
    was_down = asset.down
    asset.failed, asset.speed_factor = False, 1.0
    if asset.battery <= 0.0:
        asset.battery = 100.0
    if was_down:
        asset.post = terrain.frame_at(asset.x, asset.y)
        asset.stop("idle")


def _carried(scene: Scene, name: str) -> None:
    """Record at the station that an asset was moved, so that its new position is not suspect."""
    record = scene.station.heard.get(name)
    if record is not None:
        trust = replace(record.trust, carried_tick=scene.tick)
        scene.station.heard[name] = record._replace(trust=trust)


def _asset(terrain: Terrain, scene: Scene, name: str) -> AssetState:
    """Return the asset that an incident changes, and mark it for processing in the next step."""
    asset = scene.assets[name]
    rouse(terrain.world, scene, asset)
    return asset


def _apply_to_surroundings(terrain: Terrain, scene: Scene, incident: Incident) -> None:
    """Apply an incident about contacts, sensors, weather or the ground.

    Raises ValueError, with the names of the known contacts, for an unknown contact.
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
        case ObstructWay():
            _obstruct(terrain, scene, incident)
        case _:
            pass


def _clear(terrain: Terrain, scene: Scene, gate: str) -> None:
    """Remove every contact, phantom and track of `gate`, and their detections under way."""
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
    """Add a phantom that one sensor at `gate` reports: a working camera, or else an asset."""
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


def _obstruct(terrain: Terrain, scene: Scene, incident: ObstructWay) -> None:
    """Put an obstruction on the ground; assets detect it only when they are stuck near it.

    Raises ValueError if it has no length or would lie on a ground asset.
    """
    if incident.start == incident.end:
        raise ValueError("the obstruction's start and end are the same point")
    wall = Wall(start=incident.start, end=incident.end, thickness_m=OBSTRUCTION_M)
    for asset in scene.assets.values():
        radius = terrain.world.platforms[asset.kind].radius_m
        if asset.kind != "uav" and gap(wall, asset.x, asset.y) < radius:
            raise ValueError(f"{asset.id} stands where the obstruction would lie")
    scene.obstructions = (*scene.obstructions, wall)


def begin(scenario: Scenario | None, seed: int) -> ScriptState:
    """Return the initial state of a scenario."""
    processes = scenario.random if scenario is not None else ()
    first = (p.from_s + _gap(seed, index, 0, p.mean_s) for index, p in enumerate(processes))
    return ScriptState(seed=seed, drawn=(0,) * len(processes), next_s=tuple(first))


def play(terrain: Terrain, scene: Scene, scenario: Scenario) -> tuple[list[Incident], list[str]]:
    """Apply the events due at this tick; return them, and a sentence for each impossible event.

    Scripted events come first, in file order, so that an event may depend on an earlier event of
    the same tick.
    """
    done: list[Incident] = []
    skipped: list[str] = []
    state, now = scene.script, terrain.seconds(scene.tick) + _TIME_NOISE_S
    for index, event in enumerate(scenario.events):
        if index in state.happened or index in state.skipped:
            continue
        if index not in state.due_s:
            if event.at_s is not None:
                state.due_s[index] = event.at_s + event.delay_s
            elif _holds(terrain, scene, scenario, event.when):
                state.due_s[index] = terrain.seconds(scene.tick) + event.delay_s
            else:
                continue
        if state.due_s[index] > now:
            continue
        problem = _happen(terrain, scene, event.do)
        if problem:
            state.skipped = (*state.skipped, index)
            skipped.append(f"{event.name or f'events.{index}'} did not happen: {problem}")
        else:
            state.happened = (*state.happened, index)
            done.append(event.do)
    for index, process in enumerate(scenario.random):
        if state.next_s[index] > now:
            continue
        incident = _pick(state.seed, index, state.drawn[index], process.do)
        _draw_next(state, index, process.mean_s)
        problem = _happen(terrain, scene, incident)
        if problem:
            skipped.append(f"random.{index} ({incident.kind}) did not happen: {problem}")
        else:
            done.append(incident)
    return done, skipped


def _happen(terrain: Terrain, scene: Scene, incident: Incident) -> str:
    """Apply `incident`; return why it is impossible now, or '' if it was applied."""
    if isinstance(incident, WorkerFault):
        return ""
    try:
        apply(terrain, scene, incident)
    except ValueError as error:
        return str(error)
    return ""


def _draw_next(state: ScriptState, process: int, mean_s: float) -> None:
    """Set the time of the next event of a Poisson process; at most one happens per tick."""
    drawn = state.drawn[process] + 1
    due = state.next_s[process] + _gap(state.seed, process, drawn, mean_s)
    state.drawn = (*state.drawn[:process], drawn, *state.drawn[process + 1 :])
    state.next_s = (*state.next_s[:process], due, *state.next_s[process + 1 :])


def _gap(seed: int, process: int, number: int, mean_s: float) -> float:
    """Draw the seconds between two events of a process, independently of all other draws."""
    return random.Random(f"{seed}/{process}/{number}/gap").expovariate(1.0 / mean_s)


def _pick(seed: int, process: int, number: int, choices: tuple[Incident, ...]) -> Incident:
    return random.Random(f"{seed}/{process}/{number}/pick").choice(choices)


def _holds(
    terrain: Terrain, scene: Scene, scenario: Scenario, when: TrackIs | AssetIs | After | None
) -> bool:
    """Return whether a condition holds now."""
    match when:
        case TrackIs():
            return _track_is(scene, when)
        case AssetIs():
            return _asset_is(terrain, scene, when)
        case After(event=name):
            return any(scenario.events[index].name == name for index in scene.script.happened)
        case None:
            return False


def _track_is(scene: Scene, when: TrackIs) -> bool:
    """Return whether a condition holds for a contact's true state and the station's track of it."""
    sensing = scene.sensing
    if when.track not in sensing.named:
        return False
    contact = sensing.contacts.get(sensing.named[when.track])
    if contact is None:
        return when.state == "gone"
    track = next((file for file in sensing.files.values() if file.contact == contact.id), None)
    match when.state:
        case "present":
            return True
        case "detected" | "observed" | "identified":
            return track is not None and (
                when.state == "detected"
                or (when.state == "observed" and track.observed)
                or (when.state == "identified" and identity_of(track) != "unknown")
            )
        case "warned":
            return contact.warned_tick is not None
        case _:
            return contact.status == when.state


def _asset_is(terrain: Terrain, scene: Scene, when: AssetIs) -> bool:
    """Return whether a condition holds for an asset's true state.

    Only `silent` is judged by the asset's reports instead.
    """
    asset = scene.assets.get(when.asset)
    if asset is None:
        return False
    at = terrain.frame_at(asset.x, asset.y)
    if when.at is not None and at != when.at:
        return False
    match when.state:
        case "moving":
            return asset.speed > 0.0
        case "arrived":
            return not asset.route and at is not None and at == (when.at or asset.post)
        case "low_battery":
            return asset.battery < terrain.world.low_battery_pct
        case "failed":
            return asset.down
        case "charging":
            return asset.task == "charging"
        case "silent":
            report = scene.station.shown.get(asset.id)
            return report is not None and report.like.comms == "lost"
