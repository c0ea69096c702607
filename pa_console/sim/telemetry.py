"""Builds the common operational picture from what the assets report (paper, Step 3)."""

import math

from pa_console.schema.base import Point
from pa_console.schema.telemetry import (
    AssetStatus,
    AssetTelemetry,
    GateCover,
    Picture,
)
from pa_console.sim import sensing
from pa_console.sim.link import report_arrives
from pa_console.sim.state import AssetState, Scene
from pa_console.sim.terrain import Terrain


def report(terrain: Terrain, scene: Scene, *, lossless: bool = False) -> Picture:
    """Let every asset report and return the picture that results.

    A report lost on the link leaves the previous one standing, with its old stamp; that the link
    is lost is known at once. `lossless` reports get through a degraded link for certain.
    """
    time_s = terrain.seconds(scene.tick)
    for asset in scene.assets.values():
        arrives = report_arrives(scene, asset.id) or (lossless and asset.comms == "degraded")
        if arrives or asset.id not in scene.reports:
            scene.reports[asset.id] = _telemetry(terrain, asset, time_s)
        elif asset.comms == "lost" and scene.reports[asset.id].comms != "lost":
            scene.reports[asset.id] = _silenced(scene.reports[asset.id])
    if not lossless:
        for sensor, detections in sensing.scan(terrain, scene).items():
            sensing.receive(terrain, scene, sensor, scene.tick, detections)
    _cover(terrain, scene)
    return Picture(
        tick=scene.tick,
        time_s=time_s,
        assets=dict(scene.reports),
        tracks=sensing.tracks_known(terrain, scene),
        gates=dict(scene.covers),
        cameras=sensing.cameras_known(terrain, scene),
        weather=sensing.weather(scene),
    )


def truth(terrain: Terrain, scene: Scene) -> Picture:
    """Return the exact state as a picture."""
    time_s = terrain.seconds(scene.tick)
    return Picture(
        tick=scene.tick,
        time_s=time_s,
        assets={a.id: _telemetry(terrain, a, time_s) for a in scene.assets.values()},
        tracks=sensing.true_tracks(terrain, scene),
        gates=dict(scene.covers),
        weather=sensing.weather(scene),
    )


def _telemetry(terrain: Terrain, asset: AssetState, time_s: float) -> AssetTelemetry:
    low = asset.battery < terrain.world.low_battery_pct
    status: AssetStatus = "ok"
    if asset.down:
        status = "failed"
    elif low or asset.comms != "ok":
        status = "degraded"
    return AssetTelemetry(
        id=asset.id,
        kind=asset.kind,
        at=terrain.frame_at(asset.x, asset.y),
        post=asset.post,
        position=_rounded(asset.position),
        heading_deg=round(math.degrees(asset.heading), 1),
        speed_mps=round(asset.speed, 3),
        status=status,
        task=asset.task,
        battery_pct=round(asset.battery, 3),
        low_battery=low,
        comms=asset.comms,
        available=asset.available,
        route=tuple(_rounded(point) for point in asset.route),
        command_id=asset.command.command_id if asset.command else None,
        stamp_s=time_s,
    )


def _silenced(last: AssetTelemetry) -> AssetTelemetry:
    """Return the last report as it stands once the link is known to be lost."""
    status: AssetStatus = "failed" if last.status == "failed" else "degraded"
    return last.model_copy(update={"comms": "lost", "available": False, "status": status})


def _cover(terrain: Terrain, scene: Scene) -> None:
    """Work out from the reports which assets cover each gate, and since when none does (WF-03).

    An asset covers a gate when it is available, assigned to it and at it.
    """
    for gate in terrain.world.gates:
        by = tuple(
            asset.id
            for asset in scene.reports.values()
            if asset.available and asset.post == gate and asset.at == gate
        )
        if by:
            scene.covered_tick[gate] = scene.tick
        gap = terrain.seconds(scene.tick - scene.covered_tick.get(gate, 0))
        known = scene.covers.get(gate)
        if known is None or known.by != by or gap:
            scene.covers[gate] = GateCover(covered=bool(by), by=by, uncovered_s=gap)


def _rounded(point: Point) -> Point:
    return (round(point[0], 3), round(point[1], 3))
