"""The assets' own reports, true or forged, and the condition of cameras (paper, Step 3)."""

import math

from pa_console.schema.base import Point
from pa_console.schema.telemetry import (
    AssetStatus,
    AssetTelemetry,
    CameraReport,
)
from pa_console.sim import radio
from pa_console.sim.incidents import watch_task
from pa_console.sim.scene import AssetState, Report, Scene, SelfReport, settle_battery
from pa_console.sim.sensing import sensors, tracker
from pa_console.sim.sensing_state import Detection
from pa_console.sim.worlds.terrain import Terrain


def send(terrain: Terrain, scene: Scene) -> dict[str, tuple[Detection, ...]]:
    """Scan with every sensor and send the reports; return the detections of each camera.

    Call this once per telemetry period. Camera detections reach the station at once, because
    cameras are wired; an asset's detections travel with its report. Forged reports come from the
    forger, whatever the state of the asset's own link.
    """
    detected = sensors.scan(terrain, scene)
    world = terrain.world
    for asset in scene.assets.values():
        settle_battery(world, scene, asset)
        place = where(terrain, asset)
        if place is not None and place == asset.post and not asset.down:
            scene.covered_tick[place] = scene.tick
        if asset.spoofed is not None:
            report = Report(asset.id, scene.tick, _forged(terrain, scene, asset))
        elif radio.works(scene, asset):
            telemetry = report_of(terrain, scene.tick, asset)
            report = Report(asset.id, scene.tick, telemetry, detected.get(asset.id, ()))
        else:
            continue
        radio.send_report(scene, asset, report, world.dt_s)
    wired = {sensor: seen for sensor, seen in detected.items() if sensor not in scene.assets}
    for sensor, detections in wired.items():
        tracker.receive(terrain, scene, sensor, scene.tick, detections)
    return wired


def where(terrain: Terrain, asset: AssetState) -> str | None:
    """Return the true frame of `asset`, which is computed again only if the asset has moved."""
    if asset.placed_at != (asset.x, asset.y):
        asset.placed_at, asset.place = asset.position, terrain.frame_at(asset.x, asset.y)
    return asset.place


def report_of(terrain: Terrain, tick: int, asset: AssetState) -> SelfReport:
    """Return the report of `asset` at `tick`, which is true except for the drift of its position.

    In the report of an idle asset, only the battery and the time are new.
    """
    low, stamp_s = asset.battery < terrain.world.low_battery_pct, terrain.seconds(tick)
    last = asset.last_telemetry
    if last is not None and last.low_battery == low and asset.drift is None:
        return SelfReport(last, round(asset.battery, 3), stamp_s)
    at, position = where(terrain, asset), asset.position
    if asset.drift is not None:
        position = asset.drift.applied(position, tick, terrain.world.dt_s)
        at = terrain.frame_at(*position)
    status: AssetStatus = "degraded" if low or asset.speed_factor < 1.0 else "ok"
    down = asset.down
    asset.last_telemetry = AssetTelemetry.of_valid(
        {
            "id": asset.id,
            "kind": asset.kind,
            "at": at,
            "post": asset.post,
            "position": rounded(position),
            "heading_deg": round(math.degrees(asset.heading), 1),
            "speed_mps": round(asset.speed, 3),
            "status": "failed" if down else status,
            "task": asset.task,
            "battery_pct": round(asset.battery, 3),
            "low_battery": low,
            "comms": "ok",
            "available": not (down or asset.manual),
            "stale": False,
            "integrity": "ok",
            "route": tuple([rounded(point) for point in asset.route]),
            "command_id": asset.command.command_id if asset.command else None,
            "stamp_s": stamp_s,
            "manual": asset.manual,
            "battery_known": True,
        }
    )
    return SelfReport.of(asset.last_telemetry)


def cameras_known(terrain: Terrain, scene: Scene) -> dict[str, CameraReport]:
    """Return the condition of each camera, which is known without delay: cameras are wired."""
    now_s, broken = terrain.seconds(scene.tick), scene.sensing.broken
    return {
        name: CameraReport.of_valid(
            {"gate": camera.gate, "works": name not in broken, "stamp_s": now_s}
        )
        for name, camera in terrain.world.cameras.items()
    }


def _forged(terrain: Terrain, scene: Scene, asset: AssetState) -> SelfReport:
    """Return a forged report, in which all is well and the asset is posted at the forged frame."""
    frame = asset.spoofed or terrain.world.base
    last = scene.station.heard[asset.id].telemetry.telemetry()
    places = terrain.places(frame, asset.kind)
    forged = last.model_copy(
        update={
            "at": frame,
            "post": frame,
            "position": rounded(places[0] if places else terrain.world.frames[frame].at),
            "speed_mps": 0.0,
            "status": "ok",
            "task": watch_task(terrain, asset.kind, frame),
            "battery_pct": max(last.battery_pct, terrain.world.low_battery_pct),
            "low_battery": False,
            "available": True,
            "manual": False,
            "route": (),
            "command_id": None,
            "stamp_s": terrain.seconds(scene.tick),
        }
    )
    return SelfReport.of(forged)


def rounded(point: Point) -> Point:
    """Return `point` rounded to the millimetre."""
    return (round(point[0], 3), round(point[1], 3))
