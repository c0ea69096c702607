"""A simulation built from a picture, which continues the known state and does not use the truth.

Messages take the world's latency and are never lost. Assets that cannot be relied on (failed,
silent, stale, suspect) stand where they were last reported, cover nothing and answer nothing. An
asset under manual control also stands there, and keeps its cover. An asset under way continues to
the end of its reported route. Contacts are derived from the tracks.
"""

import math
import random

import shapely

from pa_console.schema.command import ADDRESSING, COMMANDS, DeviceCommand, Verb
from pa_console.schema.telemetry import AssetTelemetry, Picture, Task, Track
from pa_console.schema.world import World
from pa_console.sim import picture as station_side
from pa_console.sim import telemetry
from pa_console.sim.contacts import way_in
from pa_console.sim.scene import (
    AssetState,
    Heard,
    RadioState,
    Scene,
    SelfReport,
    StationState,
    settle_battery,
)
from pa_console.sim.sensing import sensors, tracker
from pa_console.sim.sensing.evidence import weight_of
from pa_console.sim.sensing_state import ContactState, Sighting, Statement, TrackFile
from pa_console.sim.worlds.terrain import Terrain

IDLE_REPORT_PERIODS = 20
"""The number of telemetry periods between two reports of an idle asset.

Only the battery of an idle asset changes.
"""
_VERBS: dict[Task, Verb] = {
    "moving": "move_to",
    **{task: verb for verb in ADDRESSING if (task := COMMANDS[verb].task)},
    "returning": "return_to_base",
}

USUAL_MPS = 5.0
"""The assumed speed, once it moves, of a contact whose speed is unknown."""


def scene_of(terrain: Terrain, picture: Picture) -> Scene:
    """Return the scene of `picture`; equal pictures give equal scenes."""
    world, dt_s = terrain.world, terrain.world.dt_s
    scene = Scene(rng=random.Random(0), tick=picture.tick, ideal=True)
    station = scene.station = StationState(at_gate={gate: {} for gate in world.gates})
    for index, report in enumerate(picture.assets.values()):
        asset = scene.assets[report.id] = _asset(world, picture.tick, index, report)
        shown = station.shown[report.id] = SelfReport.of(report)
        station.heard[report.id] = Heard(
            telemetry=shown,
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
    _restore(terrain, scene, picture)
    return scene


def report(terrain: Terrain, scene: Scene) -> station_side.Draft:
    """Report the assets that have changed, and return the picture."""
    world, station = terrain.world, scene.station
    turn = scene.tick // station_side.period_ticks(world) % IDLE_REPORT_PERIODS
    silent: list[str] = []
    for asset in scene.assets.values():
        if not asset.radio.up:
            silent.append(asset.id)
        elif asset.index % IDLE_REPORT_PERIODS == turn:
            scene.touched.add(asset.id)
    reporting = [asset for asset in scene.in_order(scene.touched) if asset.radio.up]
    for asset in reporting:
        settle_battery(world, scene, asset)
        report = telemetry.report_of(terrain, scene.tick, asset)
        station.heard[asset.id] = Heard(report, scene.tick, station.heard[asset.id].marks)
    scene.touched.clear()
    for sensor, detections in sensors.scan(terrain, scene).items():
        tracker.receive(terrain, scene, sensor, scene.tick, detections)
    return station_side.build(terrain, scene, [*(asset.id for asset in reporting), *silent])


def _asset(world: World, tick: int, index: int, report: AssetTelemetry) -> AssetState:
    """Return the state of the asset in a report; an asset that cannot be relied on stays down."""
    radio = world.radio
    answers = report.available or (report.manual and station_side.is_sure(report))
    silent = not answers and report.status != "failed" and report.battery_pct > 0.0
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
        manual=report.manual,
    )
    if asset.down:
        asset.stop("none")
    elif asset.manual:
        asset.stop("holding" if report.task in ("moving", "returning") else report.task)
    elif report.command_id is not None and report.task in _VERBS:
        verb = _VERBS[report.task]
        target = None if verb == "return_to_base" else report.post
        if verb == "return_to_base" or target is not None:
            asset.command = DeviceCommand(
                command_id=report.command_id, agent=report.id, verb=verb, target=target
            )
    return asset


def _restore(terrain: Terrain, scene: Scene, picture: Picture) -> None:
    """Set the tracks, cameras and weather of a forecast's `scene` from `picture`.

    A contact stands or moves as last detected. An unknown identity is assumed to be unauthorized. A
    warned contact stops, unless it has already ignored its warning.
    """
    state = scene.sensing
    state.weather = picture.weather
    state.broken = tuple(n for n, camera in picture.cameras.items() if not camera.works)
    for track in picture.tracks.values():
        state.contacts[track.id] = _contact_of(terrain, track)
        state.files[track.id] = _file_of(terrain, track)
    numbers = [int(n) for name in picture.tracks if (n := name.rpartition("_")[2]).isdigit()]
    state.numbered = state.spawned = max(numbers, default=0)


def _contact_of(terrain: Terrain, track: Track) -> ContactState:
    """Return the contact of a track, on the nearest lane of its gate unless it is inside."""
    inside = track.status == "inside"
    lanes = terrain.lanes_to(track.gate)
    lines = {name: shapely.LineString(terrain.world.lanes[name].points) for name in lanes}
    here = shapely.Point(track.position)
    lane = min(lanes, key=lambda name: lines[name].distance(here), default="")
    contact = ContactState(
        id=track.id,
        kind=track.kind,
        gate=track.gate,
        lane=lane,
        travelled=lines[lane].project(here) if lane else 0.0,
        x=track.position[0],
        y=track.position[1],
        heading=math.radians(track.heading_deg),
        cruise_mps=track.speed_mps or USUAL_MPS,
        identity="unauthorized" if track.identity == "unknown" else track.identity,
        intent=track.intent,
        when_warned="go_on" if track.defiant else "stop",
        noncombatants=track.noncombatants,
        emergency=track.emergency,
        speed=track.speed_mps,
        status=track.status,
        warned_tick=0 if track.warned and track.status != "leaving" else None,
        on_lane=not inside and bool(lane),
    )
    if inside and track.speed_mps > 0.0:
        contact.route = way_in(terrain, track.gate)[1:]
    return contact


def _file_of(terrain: Terrain, track: Track) -> TrackFile:
    """Return the station's file on a track, as far as the picture shows it."""
    dt_s = terrain.world.dt_s
    heading = math.radians(track.heading_deg)
    stamp = round(track.stamp_s / dt_s)
    return TrackFile(
        id=track.id,
        contact=track.id,
        kind=track.kind,
        gate=track.gate,
        x=track.position[0],
        y=track.position[1],
        vx=track.speed_mps * math.cos(heading),
        vy=track.speed_mps * math.sin(heading),
        heading=heading,
        variance=max(track.uncertainty_m, 0.05) ** 2,
        speed_variance=1.0,
        tick=stamp,
        first_tick=round(track.first_seen_s / dt_s),
        status=track.status,
        leaning=track.status,
        leaning_tick=stamp,
        identified=track.identity,
        confirmed=track.intent,
        suspected=track.noncombatants,
        emergency=track.emergency,
        statements=tuple(
            Statement(name, weight_of(terrain, name), opinion="hostile", opinion_tick=stamp)
            for name in sorted(track.hostile_by)
        ),
        seen=tuple(Sighting(sensor, stamp, track.position) for sensor in track.seen_by),
        observed=track.observed,
        warned_tick=0 if track.warned else None,
        defiant=track.defiant,
    )
