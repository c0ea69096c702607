"""The station's side of telemetry: the picture that the reports which arrived add up to.

Nothing here reads the truth: that a report is stale, a link degraded or lost, a position doubtful
is concluded from which reports came, and when (paper, Step 3; CAP-05).
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
from pa_console.sim import integrity, radio, telemetry, tracker
from pa_console.sim.scene import Heard, Report, Scene, SelfReport, StationState
from pa_console.sim.worlds.terrain import Terrain

LATE_S = 0.25
"""A report counts as late when it takes this much longer than the world's radio ever does."""
WINDOW = 16
TOLERATED = 4
"""The number of the last WINDOW reports that may be late or missing on a sound link. A quarter: one
that loses now and then a report carries commands well, sent again if need be."""
_ALL = (1 << WINDOW) - 1


def period_ticks(world: World) -> int:
    """Return how many steps a telemetry period takes."""
    return max(1, round(world.telemetry_period_s / world.dt_s))


class Draft(NamedTuple):
    """The content of a picture, before each asset's own report is put together."""

    tick: int
    time_s: float
    assets: dict[str, SelfReport]
    tracks: dict[str, Track]
    gates: dict[str, GateCover]
    cameras: dict[str, CameraReport]
    weather: Weather

    def picture(self) -> Picture:
        """Return the picture."""
        assets = {name: said.telemetry() for name, said in self.assets.items()}
        return Picture.of_valid({**self._asdict(), "assets": assets, "links": {}, "not_ready": {}})


def begin(terrain: Terrain, scene: Scene) -> Draft:
    """Return the picture before the first step, in which everything has been so for long.

    A link that works has always worked, and one that does not has long been silent.
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
        heard = station.heard[report.agent]
        carried = heard.trust.carried_tick
        if report.stamp <= heard.stamp or (carried is not None and report.stamp <= carried):
            continue
        trust = integrity.judge(world, heard, report)
        missed = (report.stamp - heard.stamp) // period
        marks = (heard.marks << min(missed, WINDOW) | (report.stamp >= latest)) & _ALL
        station.heard[report.agent] = Heard(report.telemetry, report.stamp, marks, trust)
        if report.detections and not trust.suspect:
            tracker.receive(terrain, scene, report.agent, report.stamp, report.detections)


def build(terrain: Terrain, scene: Scene, names: Iterable[str]) -> Draft:
    """Conclude anew about the assets in `names` and return the picture."""
    station = scene.station
    stirred = {gate for gate in terrain.gates if gate not in station.covers}
    silences: dict[int, _Silence] = {}
    for name in names:
        heard = station.heard[name]
        silence = silences.get(heard.stamp)
        if silence is None:
            silence = silences[heard.stamp] = _silence(terrain.world, scene, heard.stamp)
        before = station.shown.get(name)
        known = _concluded(heard, silence, before, taken=name in station.manual)
        if known is not before:
            station.shown[name] = known
            if before is None or known.like is not before.like:
                update_post(scene, before.like if before else None, known.like, stirred)
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
    """Return the marks of a link that has long been so: reports came well, or did not."""
    return 0 if comms == "degraded" else _ALL


def comms_of(heard: Heard, missing: int) -> CommsStatus:
    """Return whether reports come well; `missing` so many of the latest have not come at all."""
    marks = (heard.marks << min(missing, WINDOW)) & _ALL
    return "ok" if WINDOW - marks.bit_count() <= TOLERATED else "degraded"


class _Silence(NamedTuple):
    """The consequences of silence: a report too old to rely on, reports missing."""

    stale: bool
    lost: bool
    missing: int


def _silence(world: World, scene: Scene, stamp: int) -> _Silence:
    """Return the consequences of a latest report from tick `stamp`."""
    age = scene.tick - stamp
    age_s = round(age * world.dt_s, 6)
    missing = 0 if scene.ideal else max(0, age - _patience(world)) // period_ticks(world)
    return _Silence(age_s > world.stale_s, age_s >= world.link_lost_s, missing)


def _concluded(
    heard: Heard, silence: _Silence, shown: SelfReport | None, *, taken: bool
) -> SelfReport:
    """Return an asset's latest report with the station's conclusions about it.

    An asset that was `taken` is under manual control by the station's own record.
    """
    stale, lost, missing = silence
    whole = heard.marks == _ALL and not missing
    comms: CommsStatus = "lost" if lost else "ok" if whole else comms_of(heard, missing)
    said, suspect = heard.telemetry, heard.trust.suspect
    manual = taken or said.like.manual
    if comms == "ok" and not stale and not suspect and manual == said.like.manual:
        return said
    available = said.like.available and not (stale or suspect or manual) and comms != "lost"
    integrity_now = "suspect" if suspect else "ok"
    if (
        shown is not None
        and shown.stamp_s == said.stamp_s
        and (shown.like.comms, shown.like.stale, shown.like.integrity, shown.like.manual)
        == (comms, stale, integrity_now, manual)
    ):
        return shown
    status = "degraded" if comms != "ok" and said.like.status == "ok" else said.like.status
    concluded = said.telemetry().model_copy(
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
    """Return how many steps after it was sent a report counts as late."""
    slowest_s = world.radio.latency_s + world.radio.jitter_s + LATE_S
    return math.ceil(slowest_s / world.dt_s - 1e-9)


def update_post(
    scene: Scene, before: AssetTelemetry | None, now: AssetTelemetry, stirred: set[str]
) -> None:
    """Note at which gate an asset is by its report; add the gates where that changes to `stirred`.

    One that has failed is nowhere; of one that is stale, silent or suspect it is not sure. An asset
    under manual control covers its gate as long as its reported position does.
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
    """Return whether an asset that has not failed can be relied on to be where it reports to be."""
    if not asset.manual:
        return asset.available
    heard = not asset.stale and asset.comms != "lost" and asset.integrity == "ok"
    return heard and asset.battery_pct > 0.0


def _cover(terrain: Terrain, scene: Scene, stirred: set[str]) -> None:
    """Work out which assets are known to cover each gate, and since when none is (WF-03)."""
    station = scene.station
    for gate in terrain.gates:
        known = station.covers.get(gate)
        by, unsure = (known.by, known.unsure) if known is not None else ((), ())
        if gate in stirred:
            posted = station.at_gate.get(gate, {})
            names = sorted(posted, key=lambda name: scene.assets[name].index)
            by = tuple(name for name in names if posted[name])
            unsure = tuple(name for name in names if not posted[name])
        if by:
            station.covered_tick[gate] = scene.tick
        gap = terrain.seconds(scene.tick - station.covered_tick.get(gate, 0))
        if known is None or gate in stirred or gap != known.uncovered_s:
            station.covers[gate] = GateCover.of_valid(
                {"covered": bool(by), "by": by, "uncovered_s": gap, "unsure": unsure}
            )
