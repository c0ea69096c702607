"""Rebuilds a simulation from a picture: what is known, taken further, and nothing of the truth.

In it messages take the world's latency and are never lost. Assets that cannot be counted on
(failed, silent, stale, suspect) stand where last reported, cover nothing and answer nothing. An
asset under way goes on to where its reported route ends.
"""

import math
import random

from pa_console.schema.command import ADDRESSING, COMMANDS, DeviceCommand, Verb
from pa_console.schema.telemetry import AssetTelemetry, Picture, Task
from pa_console.schema.world import World
from pa_console.sim.assets import battery
from pa_console.sim.picture import picture as station_side
from pa_console.sim.picture import telemetry
from pa_console.sim.sensing import sensing
from pa_console.sim.state.link_state import Heard, RadioState, Said, StationState
from pa_console.sim.state.scene import AssetState, Scene
from pa_console.sim.worlds.terrain import Terrain

IDLE_REPORT_PERIODS = 20
"""The telemetry periods between two reports of an idle asset, whose battery alone changes."""
_VERBS: dict[Task, Verb] = {
    "moving": "move_to",
    **{task: verb for verb in ADDRESSING if (task := COMMANDS[verb].task)},
    "returning": "return_to_base",
}


def scene_of(terrain: Terrain, picture: Picture) -> Scene:
    """Return the scene that `picture` shows; equal pictures give equal scenes."""
    world, dt_s = terrain.world, terrain.world.dt_s
    scene = Scene(rng=random.Random(0), tick=picture.tick, ideal=True)
    station = scene.station = StationState(at_gate={gate: {} for gate in world.gates})
    for index, report in enumerate(picture.assets.values()):
        asset = scene.assets[report.id] = _asset(world, picture.tick, index, report)
        said = station.shown[report.id] = Said.of(report)
        station.heard[report.id] = Heard(
            telemetry=said,
            stamp=picture.tick if asset.radio.up else round(report.stamp_s / dt_s),
            marks=station_side.marks_of(report.comms),
        )
        station_side.update_post(scene, None, report, set())
        if asset.route or asset.command is not None:
            scene.active.add(asset.id)
    for gate, cover in picture.gates.items():
        station.covers[gate] = cover
        since = picture.tick - round(cover.uncovered_s / dt_s)
        scene.covered_tick[gate] = station.covered_tick[gate] = since
    sensing.restore(terrain, scene, picture)
    return scene


def report(terrain: Terrain, scene: Scene) -> station_side.Draft:
    """Let the assets that have changed report, and return the picture."""
    world, station = terrain.world, scene.station
    turn = scene.tick // station_side.period_ticks(world) % IDLE_REPORT_PERIODS
    silent: list[str] = []
    for asset in scene.assets.values():
        if not asset.radio.up:
            silent.append(asset.id)
        elif asset.index % IDLE_REPORT_PERIODS == turn:
            scene.touched.add(asset.id)
    heard = [asset for asset in scene.in_order(scene.touched) if asset.radio.up]
    for asset in heard:
        battery.settle(world, scene, asset)
        said = telemetry.report_of(terrain, scene.tick, asset)
        station.heard[asset.id] = Heard(said, scene.tick, station.heard[asset.id].marks)
    scene.touched.clear()
    for sensor, detections in sensing.scan(terrain, scene).items():
        sensing.receive(terrain, scene, sensor, scene.tick, detections)
    return station_side.build(terrain, scene, [*(asset.id for asset in heard), *silent])


def _asset(world: World, tick: int, index: int, report: AssetTelemetry) -> AssetState:
    """Return the asset as its report has it; one that cannot be counted on is down for good."""
    radio = world.radio
    silent = not report.available and report.status != "failed" and report.battery_pct > 0.0
    asset = AssetState(
        id=report.id,
        kind=report.kind,
        index=index,
        x=report.position[0],
        y=report.position[1],
        heading=math.radians(report.heading_deg),
        battery=report.battery_pct,
        post=report.post,
        station=report.route[-1] if report.route else report.position,
        task=report.task,
        speed=report.speed_mps,
        failed=report.status == "failed" or silent,
        radio=RadioState(radio.latency_s + radio.jitter_s / 2, 0.0, 0.0, up=not silent),
        origin=report.position,
        route=report.route,
        nearest_tick=tick,
        progress_tick=tick,
        heard_tick=tick,
        settled_tick=tick,
    )
    if asset.down:
        asset.stop("none")
    elif report.command_id is not None and report.task in _VERBS:
        verb = _VERBS[report.task]
        target = None if verb == "return_to_base" else report.post
        if verb == "return_to_base" or target is not None:
            asset.command = DeviceCommand(
                command_id=report.command_id, agent=report.id, verb=verb, target=target
            )
    return asset
