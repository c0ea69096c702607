"""The sensing steps of the checkpoint: contacts move, sensors scan, detections become tracks."""

from pa_console.schema.telemetry import CameraReport, Track, Weather
from pa_console.sim.contacts import contacts
from pa_console.sim.picture.track_report import known_track, true_track
from pa_console.sim.sensing import tracker
from pa_console.sim.sensing.forecast_tracks import restore
from pa_console.sim.sensing.sensing_incidents import apply
from pa_console.sim.sensing.sensors import scan
from pa_console.sim.sensing.tracker import receive
from pa_console.sim.state.scene import Scene
from pa_console.sim.worlds.terrain import Terrain

__all__ = [
    "advance", "apply", "cameras_known", "receive", "restore", "scan", "tracks_known",
    "true_tracks", "weather",
]  # fmt: skip


def advance(terrain: Terrain, scene: Scene, dt_s: float) -> None:
    """Move every contact by one step."""
    if scene.contacts:
        contacts.advance(terrain, scene, dt_s)


def tracks_known(terrain: Terrain, scene: Scene) -> dict[str, Track]:
    """Return the tracks of the picture, from the detections that arrived."""
    if not scene.sensing.files:
        return {}
    tracker.review(terrain, scene)
    return {file.id: known_track(terrain, scene, file) for file in scene.sensing.files.values()}


def cameras_known(terrain: Terrain, scene: Scene) -> dict[str, CameraReport]:
    """Return the condition of each camera, which its wire reports at once."""
    now_s, broken = terrain.seconds(scene.tick), scene.sensing.broken
    return {
        name: CameraReport.of_valid(
            {"gate": camera.gate, "works": name not in broken, "stamp_s": now_s}
        )
        for name, camera in terrain.world.cameras.items()
    }


def weather(scene: Scene) -> Weather:
    """Return the weather, which is known everywhere."""
    return scene.sensing.weather


def true_tracks(terrain: Terrain, scene: Scene) -> dict[str, Track]:
    """Return every contact exactly, under its track id if it has one, else its contact id."""
    found = (true_track(terrain, scene, contact) for contact in scene.contacts.values())
    return {track.id: track for track in found}
