"""Applies incidents to a scene: set-up of missions, scenarios and what-if."""

from collections.abc import Iterable

from pa_console.schema.incident import (
    FailAsset,
    Incident,
    PlaceAsset,
    RestoreAsset,
    SetBattery,
    SetComms,
)
from pa_console.schema.telemetry import Task
from pa_console.sim import obstructions, sensing
from pa_console.sim.state import AssetState, Scene
from pa_console.sim.terrain import Terrain


def apply(terrain: Terrain, scene: Scene, incident: Incident) -> None:
    """Make `incident` true in `scene`; raises ValueError naming what exists for unknown names."""
    match incident:
        case FailAsset(asset=name):
            _asset(scene, name).failed = True
        case RestoreAsset(asset=name):
            _restore(terrain, _asset(scene, name))
        case SetBattery(asset=name, percent=percent):
            _asset(scene, name).battery = percent
        case SetComms(asset=name, comms=comms):
            _asset(scene, name).comms = comms
        case PlaceAsset(asset=name, frame=frame):
            _known("frame", frame, terrain.world.frames)
            place(terrain, scene, _asset(scene, name), frame)
        case _:
            sensing.apply(terrain, scene, incident) or obstructions.apply(terrain, scene, incident)


def place(terrain: Terrain, scene: Scene, asset: AssetState, frame: str) -> None:
    """Stand `asset` at a free place of `frame`, assigned to it; ValueError when there is none."""
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
    """Return the task of an asset that has its watch at `frame`: UAVs observe their gate."""
    return "observing" if kind == "uav" and frame in terrain.world.gates else "idle"


def _restore(terrain: Terrain, asset: AssetState) -> None:
    """Make the asset work again where it stands, with a fresh battery if its own is empty.

    It is assigned to the frame it is at, if any.
    """
    was_down = asset.down
    asset.failed = False
    if asset.battery <= 0.0:
        asset.battery = 100.0
    if was_down:
        asset.post = terrain.frame_at(asset.x, asset.y)
        asset.stop("idle")


def _asset(scene: Scene, name: str) -> AssetState:
    _known("asset", name, scene.assets)
    return scene.assets[name]


def _known(what: str, name: str, names: Iterable[str]) -> None:
    known = tuple(names)
    if name not in known:
        raise ValueError(f"there is no {what} {name!r}; known: {', '.join(known)}")
