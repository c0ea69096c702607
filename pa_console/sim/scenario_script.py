"""Plays a scenario inside the simulation: what happens, when, and on which condition."""

import random

from pa_console.schema.incident import Incident, WorkerFault
from pa_console.schema.scenario import After, AssetIs, Scenario, TrackIs
from pa_console.sim import incidents
from pa_console.sim.sensing.evidence import identity_of
from pa_console.sim.state.scene import Scene, ScriptState
from pa_console.sim.worlds.terrain import Terrain

_TIME_NOISE_S = 1e-9


def begin(scenario: Scenario | None, seed: int) -> ScriptState:
    """Return the initial state of a scenario."""
    processes = scenario.random if scenario is not None else ()
    first = (p.from_s + _gap(seed, index, 0, p.mean_s) for index, p in enumerate(processes))
    return ScriptState(seed=seed, drawn=(0,) * len(processes), next_s=tuple(first))


def play(terrain: Terrain, scene: Scene, scenario: Scenario) -> tuple[list[Incident], list[str]]:
    """Apply the events due at this tick; return them, and a sentence for each impossible one.

    Scripted events go first, in file order, so one may follow an earlier one within the tick.
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
        problem = _apply(terrain, scene, event.do)
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
        problem = _apply(terrain, scene, incident)
        if problem:
            skipped.append(f"random.{index} ({incident.kind}) did not happen: {problem}")
        else:
            done.append(incident)
    return done, skipped


def _apply(terrain: Terrain, scene: Scene, incident: Incident) -> str:
    """Make `incident` true; return why that is impossible at this moment, '' when it was done."""
    if isinstance(incident, WorkerFault):
        return ""
    try:
        incidents.apply(terrain, scene, incident)
    except ValueError as error:
        return str(error)
    return ""


def _draw_next(state: ScriptState, process: int, mean_s: float) -> None:
    """Set when the next event of a Poisson process is due; at most one a tick happens."""
    drawn = state.drawn[process] + 1
    due = state.next_s[process] + _gap(state.seed, process, drawn, mean_s)
    state.drawn = (*state.drawn[:process], drawn, *state.drawn[process + 1 :])
    state.next_s = (*state.next_s[:process], due, *state.next_s[process + 1 :])


def _gap(seed: int, process: int, number: int, mean_s: float) -> float:
    """Return the seconds between two events of a process; depends on nothing else that is drawn."""
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
    """Compare with the truth of a contact, and with what the station has made of it."""
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
    """Compare with the truth of an asset; `silent` is what the station makes of its reports."""
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
