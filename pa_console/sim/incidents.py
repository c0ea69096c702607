"""Applies incidents to a scene: set-up of missions, scenarios and what-if."""

import math
from dataclasses import replace

from pa_console.schema.incident import (
    DegradeAsset,
    FailAsset,
    GpsDrift,
    Incident,
    JamArea,
    PlaceAsset,
    RestoreAsset,
    SetBattery,
    SetComms,
    SetRadio,
    SpoofTelemetry,
    unknown_name,
)
from pa_console.schema.telemetry import Task
from pa_console.sim.assets import battery, obstructions
from pa_console.sim.radio import radio
from pa_console.sim.sensing import sensing
from pa_console.sim.state.link_state import Drift
from pa_console.sim.state.scene import AssetState, Scene
from pa_console.sim.worlds.terrain import Terrain


def apply(terrain: Terrain, scene: Scene, incident: Incident) -> None:
    """Make `incident` true in `scene`; raises ValueError naming what exists for unknown names."""
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
            for each in scene.assets if name is None else (name,):
                radio.set_radio(_asset(terrain, scene, each), incident)
        case JamArea():
            radio.jam(terrain.world, scene, incident)
        case GpsDrift(asset=name, rate_mps=rate, heading_deg=heading_deg):
            heading = math.radians(heading_deg)
            drift = Drift(rate * math.cos(heading), rate * math.sin(heading), scene.tick)
            _asset(terrain, scene, name).drift = drift if rate > 0.0 else None
        case SpoofTelemetry(asset=name, frame=frame):
            _asset(terrain, scene, name).spoofed = frame
        case PlaceAsset(asset=name, frame=frame):
            place(terrain, scene, _asset(terrain, scene, name), frame)
            _carried(scene, name)
        case _:
            if not sensing.apply(terrain, scene, incident):
                obstructions.apply(terrain, scene, incident)


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
    asset.failed, asset.speed_factor = False, 1.0
    if asset.battery <= 0.0:
        asset.battery = 100.0
    if was_down:
        asset.post = terrain.frame_at(asset.x, asset.y)
        asset.stop("idle")


def _carried(scene: Scene, name: str) -> None:
    """Note at the station that an asset was carried elsewhere: its new position is no forgery."""
    heard = scene.station.heard.get(name)
    if heard is not None:
        trust = replace(heard.trust, carried_tick=scene.tick)
        scene.station.heard[name] = heard._replace(trust=trust)


def _asset(terrain: Terrain, scene: Scene, name: str) -> AssetState:
    """Return the asset that something happens to; the next step looks after it."""
    asset = scene.assets[name]
    battery.rouse(terrain.world, scene, asset)
    return asset
