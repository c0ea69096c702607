"""The station's tracks: detections that arrive, brought together to one estimate per contact.

Which detections belong together is told by the contact's signature (plate, shape, gait), so that
association is perfect; position, velocity and what follows from them are estimated.
"""

import math

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Intent
from pa_console.sim.estimate import measure
from pa_console.sim.sensing_state import Detection, TrackFile
from pa_console.sim.state import Scene
from pa_console.sim.terrain import Terrain
from pa_console.sim.track_status import conclude

DROP_S = 20.0
"""A track is dropped so long after its last detection."""
TWO_SENSORS = 2
"""So many independent sensors must agree before an intent is confirmed (ROE-01, ROE-10)."""


def receive(
    terrain: Terrain, scene: Scene, sensor: str, stamp: int, detections: tuple[Detection, ...]
) -> None:
    """Take in what `sensor` detected at tick `stamp`; a contact not tracked becomes a track."""
    state = scene.sensing
    for detection in detections:
        if detection.contact in state.cleared:
            continue
        file = state.files.get(detection.contact)
        if file is None and detection.position is not None:
            file = _open(terrain, scene, stamp, detection, detection.position)
        elif file is not None and detection.position is not None:
            measure(file, detection.position, detection.sigma_m, stamp, terrain.world.dt_s)
        if file is not None:
            _learn(terrain, file, sensor, stamp, detection)


def review(terrain: Terrain, scene: Scene) -> None:
    """Conclude what each track detected since the last review is doing.

    A track that has not been detected for DROP_S seconds is dropped.
    """
    for contact, file in list(scene.sensing.files.items()):
        if terrain.seconds(scene.tick - file.tick) >= DROP_S:
            del scene.sensing.files[contact]
        elif file.tick > file.reviewed_tick:
            file.reviewed_tick = file.tick
            conclude(terrain, file)


def intent_of(file: TrackFile) -> Intent:
    """Return the intent that the sensors' opinions confirm.

    Hostile takes two independent sensors; benign takes two as well, or the one that identified
    the contact, and nobody who says hostile.
    """
    hostile = len(hostile_by(file))
    if hostile >= TWO_SENSORS:
        return "hostile"
    benign = sum(opinion == "benign" for _, opinion in file.opinions)
    needed = 1 if file.identity != "unknown" else TWO_SENSORS
    if hostile:
        return "unknown"
    return "benign" if benign >= needed else file.confirmed


def hostile_by(file: TrackFile) -> tuple[str, ...]:
    """Return the sensors that hold the contact for hostile, sorted."""
    return tuple(sorted(sensor for sensor, opinion in file.opinions if opinion == "hostile"))


def name_of(scene: Scene, contact: str) -> str:
    """Return the track id that the station has given a contact, '' if it does not track it."""
    file = scene.sensing.files.get(contact)
    return "" if file is None else file.id


def _open(terrain: Terrain, scene: Scene, stamp: int, detection: Detection, at: Point) -> TrackFile:
    """Begin a track, numbered in the order of first detection, heading for its gate."""
    state = scene.sensing
    state.numbered += 1
    gate = terrain.sight.gate_of(at)
    ahead = terrain.world.frames[gate].at
    file = TrackFile(
        id=f"Track_{state.numbered:02d}",
        contact=detection.contact,
        kind=detection.kind,
        gate=gate,
        x=at[0],
        y=at[1],
        heading=math.atan2(ahead[1] - at[1], ahead[0] - at[0]),
        variance=0.0,
        tick=stamp,
        first_tick=stamp,
    )
    measure(file, at, detection.sigma_m, stamp, terrain.world.dt_s)
    state.files[detection.contact] = file
    return file


def _learn(
    terrain: Terrain, file: TrackFile, sensor: str, stamp: int, detection: Detection
) -> None:
    """Keep what a detection tells beside the position."""
    if detection.position is not None:
        latest = max(stamp, dict(file.seen).get(sensor, stamp))
        others = tuple(entry for entry in file.seen if entry[0] != sensor)
        file.seen = (*others, (sensor, latest))
        asset = terrain.world.assets.get(sensor)
        file.observed = file.observed or (asset is not None and asset.kind == "uav")
    if detection.identity != "unknown":
        file.identity = detection.identity
    if detection.opinion != "unknown":
        others = tuple(entry for entry in file.opinions if entry[0] != sensor)
        file.opinions = (*others, (sensor, detection.opinion))
    file.noncombatants = file.noncombatants or detection.noncombatants
    if detection.warned_tick is not None and file.warned_tick is None:
        file.warned_tick = detection.warned_tick
