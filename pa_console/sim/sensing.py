"""What the checkpoint asks of sensing: contacts move, sensors scan, detections become tracks."""

import math

from pa_console.schema.incident import Incident
from pa_console.schema.telemetry import CameraReport, Picture, Track, Weather
from pa_console.sim import tracks
from pa_console.sim.state import Detection, Scene, TrackState
from pa_console.sim.terrain import Terrain


def advance(terrain: Terrain, scene: Scene, dt_s: float) -> None:
    """Move every contact by one step."""
    if scene.tracks:
        tracks.advance(terrain, scene, dt_s)


def scan(terrain: Terrain, scene: Scene) -> dict[str, tuple[Detection, ...]]:
    """Return what every sensor (asset or camera) detects now; one that sees nothing is left out.

    An asset's detections travel with its report over its link; a camera's are wired.
    """
    del terrain, scene
    return {}


def receive(
    terrain: Terrain, scene: Scene, sensor: str, stamp: int, detections: tuple[Detection, ...]
) -> None:
    """Take in the detections of `sensor` at tick `stamp`, which have just reached the station."""
    del terrain, scene, sensor, stamp, detections


def tracks_known(terrain: Terrain, scene: Scene) -> dict[str, Track]:
    """Return the tracks of the picture, as the detections that arrived tell of them."""
    return {t.id: _exact(terrain, scene, t) for t in scene.tracks.values()}


def cameras_known(terrain: Terrain, scene: Scene) -> dict[str, CameraReport]:
    """Return what the station knows of the gate cameras."""
    del terrain, scene
    return {}


def weather(scene: Scene) -> Weather:
    """Return the weather, which everybody sees."""
    del scene
    return "clear"


def true_tracks(terrain: Terrain, scene: Scene) -> dict[str, Track]:
    """Return every contact exactly, under its track id if it has one, else its contact id."""
    return {t.id: _exact(terrain, scene, t) for t in scene.tracks.values()}


def restore(terrain: Terrain, scene: Scene, picture: Picture) -> None:
    """Put into a forecast's `scene` what `picture` tells of tracks, cameras and weather."""
    del terrain, scene, picture


def apply(terrain: Terrain, scene: Scene, incident: Incident) -> bool:
    """Make an incident about contacts, sensors or weather true; return whether it was one."""
    del terrain, scene, incident
    return False


def _exact(terrain: Terrain, scene: Scene, track: TrackState) -> Track:
    line = terrain.lanes[track.lane]
    point, heading = line.locate(track.travelled)
    if track.status == "leaving":
        heading = math.remainder(heading + math.pi, math.tau)
    reach = terrain.world.platforms
    seen_by = tuple(
        asset.id
        for asset in scene.assets.values()
        if asset.kind == "uav"
        and not asset.down
        and math.dist(asset.position, point) <= reach["uav"].sensor_range_m
    )
    track.observed = track.observed or bool(seen_by)
    return Track(
        id=track.id,
        kind=track.kind,
        gate=track.gate,
        position=(round(point[0], 3), round(point[1], 3)),
        heading_deg=round(math.degrees(heading), 1),
        speed_mps=round(track.speed, 3),
        distance_m=round(line.gap_to_gate(track.travelled), 3),
        identity=track.identity,
        intent=track.intent,
        status=track.status,
        observed_by=seen_by,
        observed=track.observed,
        warned=track.warned,
        stamp_s=terrain.seconds(scene.tick),
    )
