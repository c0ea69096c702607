"""The station's side of telemetry: the picture built from the reports that arrived.

This module never reads the truth. It concludes from the reports that arrived, and from their times,
that a report is stale, a link degraded or lost, or a position doubtful (paper, Step 3; CAP-05).
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from pa_console.schema.telemetry import (
    AssetTelemetry,
    CameraReport,
    CommsStatus,
    GateCover,
    Picture,
    Track,
    Weather,
)
from pa_console.schema.world import World
from pa_console.sim import radio, telemetry
from pa_console.sim.scene import Heard, Report, Scene, SelfReport, StationState
from pa_console.sim.sensing import integrity, tracker
from pa_console.sim.worlds.terrain import Terrain

LATE_S = 0.25
"""The seconds after the world's slowest radio delay at which a missing report counts as late."""
WINDOW = 16
TOLERATED = 4
"""The number of the last WINDOW reports that may be late or missing on a good link.

It is a quarter of them, because a link that sometimes loses a report still carries commands, which
are repeated if necessary.
"""
_ALL = (1 << WINDOW) - 1


def period_ticks(world: World) -> int:
    """Return the number of steps in a telemetry period."""
    return max(1, round(world.telemetry_period_s / world.dt_s))


class Draft(NamedTuple):
    """The content of a picture before the assets' reports are assembled."""

    tick: int
    time_s: float
    assets: dict[str, SelfReport]
    tracks: dict[str, Track]
    gates: dict[str, GateCover]
    cameras: dict[str, CameraReport]
    weather: Weather

    def picture(self) -> Picture:
        """Return the picture."""
        assets = {name: report.telemetry() for name, report in self.assets.items()}
        return Picture.of_valid({**self._asdict(), "assets": assets, "links": {}, "not_ready": {}})


def begin(terrain: Terrain, scene: Scene) -> Draft:
    """Return the picture before the first step, as if the initial state had lasted a long time.

    A working link has always worked, and a broken link has long been silent.
    """
    world = terrain.world
    station = scene.station = StationState(at_gate={gate: {} for gate in world.gates})
    long_ago = scene.tick - math.ceil(max(world.link_lost_s, world.stale_s) / world.dt_s) - 1
    for asset in scene.assets.values():
        comms = radio.quality(world, scene, asset)
        station.heard[asset.id] = Heard(
            telemetry=telemetry.report_of(terrain, scene.tick, asset),
            stamp=long_ago if comms == "lost" else scene.tick,
            marks=marks_of(comms),
        )
    return build(terrain, scene, scene.assets)


def receive(terrain: Terrain, scene: Scene, reports: Sequence[Report]) -> None:
    """Process the reports that have just arrived, except those older than one already received.

    Detections by a suspect asset are ignored, because its position may be false.
    """
    if not reports:
        return
    world, station = terrain.world, scene.station
    latest, period = scene.tick - _patience(world), period_ticks(world)
    for report in reports:
        record = station.heard[report.agent]
        carried = record.trust.carried_tick
        if report.stamp <= record.stamp or (carried is not None and report.stamp <= carried):
            continue
        trust = integrity.judge(world, record, report)
        missed = (report.stamp - record.stamp) // period
        marks = (record.marks << min(missed, WINDOW) | (report.stamp >= latest)) & _ALL
        station.heard[report.agent] = Heard(report.telemetry, report.stamp, marks, trust)
        if report.detections and not trust.suspect:
            tracker.receive(terrain, scene, report.agent, report.stamp, report.detections)


def build(terrain: Terrain, scene: Scene, names: Iterable[str]) -> Draft:
    """Update the conclusions about the assets in `names` and return the picture."""
    station = scene.station
    stirred = {gate for gate in terrain.gates if gate not in station.covers}
    silences: dict[int, _Silence] = {}
    for name in names:
        record = station.heard[name]
        silence = silences.get(record.stamp)
        if silence is None:
            silence = silences[record.stamp] = _silence(terrain.world, scene, record.stamp)
        before = station.shown.get(name)
        concluded = _concluded(record, silence, before, taken=name in station.manual)
        if concluded is not before:
            station.shown[name] = concluded
            if before is None or concluded.like is not before.like:
                update_post(scene, before.like if before else None, concluded.like, stirred)
    _cover(terrain, scene, stirred)
    return Draft(
        tick=scene.tick,
        time_s=terrain.seconds(scene.tick),
        assets=dict(station.shown),
        tracks=tracker.tracks_known(terrain, scene),
        gates=dict(station.covers),
        cameras=telemetry.cameras_known(terrain, scene),
        weather=scene.sensing.weather,
    )


def marks_of(comms: CommsStatus) -> int:
    """Return the marks of a link that has long been in the state `comms`."""
    return 0 if comms == "degraded" else _ALL


def comms_of(record: Heard, missing: int) -> CommsStatus:
    """Return the quality of a link; `missing` counts the latest reports that have not arrived."""
    marks = (record.marks << min(missing, WINDOW)) & _ALL
    return "ok" if WINDOW - marks.bit_count() <= TOLERATED else "degraded"


class _Silence(NamedTuple):
    """The consequences of an asset's silence.

    They are whether its latest report is too old to rely on, whether its link is lost, and how many
    reports are missing.
    """

    stale: bool
    lost: bool
    missing: int


def _silence(world: World, scene: Scene, stamp: int) -> _Silence:
    """Return the consequences of silence since a report sent at tick `stamp`."""
    age = scene.tick - stamp
    age_s = round(age * world.dt_s, 6)
    missing = 0 if scene.ideal else max(0, age - _patience(world)) // period_ticks(world)
    return _Silence(age_s > world.stale_s, age_s >= world.link_lost_s, missing)


def _concluded(
    record: Heard, silence: _Silence, shown: SelfReport | None, *, taken: bool
) -> SelfReport:
    """Return an asset's latest report with the station's conclusions about it.

    `taken` is True if the asset is under manual control by the station's own record.
    """
    stale, lost, missing = silence
    whole = record.marks == _ALL and not missing
    comms: CommsStatus = "lost" if lost else "ok" if whole else comms_of(record, missing)
    last, suspect = record.telemetry, record.trust.suspect
    manual = taken or last.like.manual
    if comms == "ok" and not stale and not suspect and manual == last.like.manual:
        return last
    available = last.like.available and not (stale or suspect or manual) and comms != "lost"
    integrity_now = "suspect" if suspect else "ok"
    if (
        shown is not None
        and shown.stamp_s == last.stamp_s
        and (shown.like.comms, shown.like.stale, shown.like.integrity, shown.like.manual)
        == (comms, stale, integrity_now, manual)
    ):
        return shown
    status = "degraded" if comms != "ok" and last.like.status == "ok" else last.like.status
    concluded = last.telemetry().model_copy(
        update={
            "comms": comms,
            "stale": stale,
            "integrity": integrity_now,
            "available": available,
            "status": status,
            "manual": manual,
        }
    )
    return SelfReport.of(concluded)


def _patience(world: World) -> int:
    """Return the number of steps from the sending of a report until it counts as late."""
    slowest_s = world.radio.latency_s + world.radio.jitter_s + LATE_S
    return math.ceil(slowest_s / world.dt_s - 1e-9)


def update_post(
    scene: Scene, before: AssetTelemetry | None, now: AssetTelemetry, stirred: set[str]
) -> None:
    """Record the gate of an asset according to its report; add the affected gates to `stirred`.

    A failed asset is at no gate. The presence of a stale, silent or suspect asset is uncertain. An
    asset under manual control covers its gate while its reported position is there.
    """
    at_gate = scene.station.at_gate
    old = before.at if before is not None and before.at == before.post else None
    new = now.at if now.at == now.post and now.status != "failed" else None
    if old is not None and old != new and at_gate.get(old, {}).pop(now.id, None) is not None:
        stirred.add(old)
    sure = is_sure(now)
    if new is not None and new in at_gate and at_gate[new].get(now.id) is not sure:
        at_gate[new][now.id] = sure
        stirred.add(new)


def is_sure(asset: AssetTelemetry) -> bool:
    """Return whether an asset that has not failed is certain to be at its reported place."""
    if not asset.manual:
        return asset.available
    reliable = not asset.stale and asset.comms != "lost" and asset.integrity == "ok"
    return reliable and asset.battery_pct > 0.0


def _cover(terrain: Terrain, scene: Scene, stirred: set[str]) -> None:
    """Update which assets are known to cover each gate, and for how long none has (WF-03)."""
    station = scene.station
    for gate in terrain.gates:
        before = station.covers.get(gate)
        by, unsure = (before.by, before.unsure) if before is not None else ((), ())
        if gate in stirred:
            posted = station.at_gate.get(gate, {})
            names = sorted(posted, key=lambda name: scene.assets[name].index)
            by = tuple(name for name in names if posted[name])
            unsure = tuple(name for name in names if not posted[name])
        if by:
            station.covered_tick[gate] = scene.tick
        gap = terrain.seconds(scene.tick - station.covered_tick.get(gate, 0))
        if before is None or gate in stirred or gap != before.uncovered_s:
            station.covers[gate] = GateCover.of_valid(
                {"covered": bool(by), "by": by, "uncovered_s": gap, "unsure": unsure}
            )
