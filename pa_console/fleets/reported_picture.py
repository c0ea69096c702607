"""The picture built from the reports of a fleet's robots, without any truth.

The same code as in a simulated fleet decides whether a report is stale, a link is lost or a
position is doubtful, and fuses the detections of all sensors into tracks.

A faulty or malicious sensor can report any number of contacts. Each of them would become a track,
an alarm and a mission, and hide the real contacts. Therefore, contacts beyond the range of their
sensor are discarded. A limit for each sensor keeps room for the contacts of the other sensors.
"""

import math
import random
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

from pa_console.fleets.reports import ContactReport, SensorReport
from pa_console.schema.base import Point
from pa_console.schema.telemetry import AssetTelemetry, Picture, Weather
from pa_console.schema.text import count
from pa_console.schema.world import World
from pa_console.sim import picture as station_side
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.scene import (
    AssetState,
    Heard,
    PositionTrust,
    Report,
    Scene,
    SelfReport,
    StationState,
)
from pa_console.sim.sensing import integrity, tracker
from pa_console.sim.sensing.integrity import NOISE_M, SPEED_MARGIN
from pa_console.sim.sensing_state import Detection, TrackFile
from pa_console.sim.worlds.terrain import Terrain

MOST_CONTACTS = 64
"""The largest number of contacts accepted from one message; a busy gate has about ten."""

MOST_ALONE = 32
"""The largest number of tracks from one sensor alone; a crowd at a gate has fewer."""

MOST_TRACKS = 128
"""The largest number of tracks in total.

Rules, rehearsal and map process every track in every picture. Three malicious sensors cannot use
up this limit. In a full picture, a contact of a sensor with few tracks replaces a track of a
sensor with many.
"""

SIGMAS = 5.0
"""The largest accepted error of a measurement, in standard deviations of its sensor's noise.

A larger error occurs once in 200,000 measurements.
"""

SEEN_PERIODS = 2.0
"""The time for which a sighting of an asset by another sensor is used, in telemetry periods."""

T = TypeVar("T")


class SetAside(NamedTuple):
    """A notice about discarded contacts of `sensor`; `text` follows the name of the sensor."""

    sensor: str
    text: str
    kind: str


class Reach(NamedTuple):
    """The position of a sensor and its range, which noise and movement extend by `doubt_m`."""

    at: Point
    range_m: float
    doubt_m: float

    @classmethod
    def of_camera(cls, world: World, name: str) -> "Reach":
        """Return the reach of a fixed camera."""
        camera = world.cameras[name]
        return cls(camera.at, camera.sensor_range_m, SIGMAS * camera.position_noise_m)

    @classmethod
    def of_asset(cls, world: World, name: str, heard: Heard, stamp: int) -> "Reach":
        """Return the reach of an asset at tick `stamp`, from its last reported position."""
        platform = world.platforms[world.assets[name].kind]
        elapsed_s = abs(stamp - heard.stamp) * world.dt_s
        moved_m = SPEED_MARGIN * platform.speed_mps * elapsed_s + NOISE_M
        doubt_m = moved_m + SIGMAS * platform.position_noise_m
        return cls(heard.telemetry.like.position, platform.sensor_range_m, doubt_m)

    def covers(self, at: Point) -> bool:
        """Return whether an object with the measured position `at` may be in view."""
        return math.dist(self.at, at) <= self.range_m + self.doubt_m


def within_share(
    files: dict[str, TrackFile], sensor: str, detections: Sequence[Detection]
) -> tuple[list[Detection], list[SetAside]]:
    """Return the accepted detections of `sensor`, and a notice for each limit that was reached.

    Contacts that already have tracks are accepted first. If there are MOST_TRACKS tracks, a new
    contact replaces a track of a sensor that reports more; that track is removed from `files`.
    """
    ordered = sorted(detections, key=lambda detection: detection.contact not in files)
    own = frozenset((sensor,))
    alone = sum(_sensors(file) == own for file in files.values())
    taken: list[Detection] = []
    new: set[str] = set()
    gave_way: Counter[str] = Counter()
    room = MOST_ALONE - alone
    for detection in ordered[:MOST_CONTACTS]:
        has_track = detection.contact in files or detection.contact in new
        if not has_track and detection.position is not None:
            if len(new) >= room:
                continue
            if len(files) + len(new) >= MOST_TRACKS:
                other = _make_room(files, sensor, alone + len(new))
                if other is None:  # there is no room for the remaining contacts either
                    room = 0
                    continue
                gave_way[other] += 1
            new.add(detection.contact)
        taken.append(detection)
    aside = [
        SetAside(other, f"reports so much that it lost {count(number, 'track')}", "gave way")
        for other, number in gave_way.items()
    ]
    if len(taken) < len(detections):
        text = (
            f"reports {len(detections)} contacts: {len(taken)} are accepted, the rest is set aside"
        )
        aside.append(SetAside(sensor, text, "many contacts"))
    return taken, aside


def _make_room(files: dict[str, TrackFile], sensor: str, alone: int) -> str | None:
    """Remove the newest track of the sensors with the most tracks; return one of these sensors.

    Every sensor of the removed track has more tracks than `sensor`, which alone detects `alone`
    tracks. Returns None, without removing anything, if there is no such track.
    """
    load = Counter(name for file in files.values() for name in _sensors(file))
    least = {
        contact: min((load[name] for name in _sensors(file)), default=0)
        for contact, file in files.items()
    }
    newest = max(files, key=lambda contact: (least[contact], files[contact].first_tick))
    if least[newest] <= max(load[sensor], alone) + 1:
        return None
    return min(_sensors(files.pop(newest)), key=lambda name: (load[name], name))


def _sensors(file: TrackFile) -> frozenset[str]:
    """Return the sensors that have detected the contact of a track."""
    return frozenset(sighting.sensor for sighting in file.seen)


class ReportedPicture:
    """The picture of a fleet, built from reports and detections.

    Each of them is dated by the tick at which it was sent. Ticks are steps of `world.dt_s` on the
    station's clock. No message can prevent a picture: a message that causes an error is left out,
    and `show` returns its sender.
    """

    def __init__(self, world: World) -> None:
        self.terrain = Terrain.of(world)
        self.links: dict[str, str] = {}
        """The link of each asset, by name; empty in a fleet with only one link."""
        self._not_ready: dict[str, str] = {}
        self._manual: frozenset[str] = frozenset()
        self.begin(0)

    @property
    def world(self) -> World:
        """The world of the fleet."""
        return self.terrain.world

    def begin(self, tick: int) -> None:
        """Reset the picture at `tick`, as if no asset and no camera had ever reported."""
        world = self.world
        scene = self._scene = Scene(rng=random.Random(0), tick=tick)
        at_gate = {gate: dict[str, bool]() for gate in world.gates}
        scene.station = StationState(at_gate=at_gate, manual=self._manual)
        self._never = tick - math.ceil(max(world.link_lost_s, world.stale_s) / world.dt_s) - 1
        self._cameras: dict[str, tuple[int, bool]] = {}
        self._lag_s = 0.0
        self._recognised: dict[str, tuple[int, Point]] = {}
        self._lags: dict[str, float] = {}
        """The lag of the station's clock at the latest report of each asset, in seconds."""
        self._watched: dict[str, int] = {}
        """The tick of the latest detections of each asset that reports detections."""
        self._taken: list[tuple[str, Callable[[], object]]] = []
        """The messages processed since the last picture, each with its sender."""
        for index, (name, spec) in enumerate(world.assets.items()):
            at = world.frames[spec.post].at
            scene.assets[name] = AssetState(
                name, spec.kind, index, *at, 0.0, 0.0, None, at, failed=True
            )
            unheard = SelfReport.of(_unheard(name, self.terrain))
            scene.station.heard[name] = Heard(
                unheard, self._never, marks=station_side.marks_of("ok")
            )
        self._keep()
        self.show()

    def report(self, name: str, stamp: int, telemetry: AssetTelemetry) -> None:
        """Process the report of asset `name` from tick `stamp`, unless a newer one is known."""
        self._take(name, partial(self._report, name, stamp, telemetry, self._lag_s))

    def _report(self, name: str, stamp: int, telemetry: AssetTelemetry, lag_s: float) -> None:
        scene = self._scene
        heard = scene.station.heard[name]
        if stamp <= heard.stamp:
            return
        held_up_s = max(0.0, lag_s - self._lags.get(name, lag_s))
        self._lags[name] = lag_s
        asset = scene.assets[name]
        asset.x, asset.y = telemetry.position
        asset.battery, asset.failed = telemetry.battery_pct, telemetry.status == "failed"
        if heard.stamp <= self._never:
            scene.station.heard[name] = Heard(
                SelfReport.of(telemetry), stamp, station_side.marks_of("ok")
            )
            return
        report = Report(name, stamp, SelfReport.of(telemetry), held_up_s=held_up_s)
        station_side.receive(self.terrain, scene, (report,))

    def break_link(self, name: str) -> None:
        """Mark the connection to asset `name` as lost."""
        self._take(name, partial(self._break_link, name))

    def _break_link(self, name: str) -> None:
        heard = self._scene.station.heard[name]
        lost = self._scene.tick - math.ceil(self.world.link_lost_s / self.world.dt_s)
        self._scene.station.heard[name] = heard._replace(stamp=min(heard.stamp, lost))

    def detect(self, stamp: int, seen: SensorReport) -> tuple[SetAside, ...]:
        """Process detections by an asset or a camera at tick `stamp`.

        Returns notices about discarded detections. Detections by a suspect asset are ignored,
        because its position may be false.
        """
        return self._take(seen.sensor, partial(self._detect, stamp, seen))

    def _detect(self, stamp: int, seen: SensorReport) -> tuple[SetAside, ...]:
        scene, world, sensor = self._scene, self.world, seen.sensor
        if sensor in world.cameras:
            if stamp < self._cameras.get(sensor, (stamp, True))[0]:
                return ()
            self._cameras[sensor] = (stamp, seen.works)
            if not seen.works:
                return ()
            reach = Reach.of_camera(world, sensor)
        else:
            heard = scene.station.heard[sensor]
            if heard.trust.suspect:
                return ()
            if heard.stamp <= self._never:
                text = "reports contacts but not its own position: set aside"
                return (SetAside(sensor, text, "no place"),) if seen.contacts else ()
            reach = Reach.of_asset(world, sensor, heard, stamp)
            self._watched[sensor] = max(stamp, self._watched.get(sensor, stamp))
        team = {name: at for name, at in seen.team.items() if reach.covers(at)}
        for name, at in team.items():
            if name in scene.assets and name != sensor:
                self._recognised[name] = (stamp, at)
        detections = [_detection(contact, stamp, world.dt_s) for contact in seen.contacts]
        near = [each for each in detections if each.position is None or reach.covers(each.position)]
        taken, aside = within_share(scene.sensing.files, sensor, near)
        tracker.receive(self.terrain, scene, sensor, stamp, tuple(taken))
        far = len(seen.team) - len(team) + len(detections) - len(near)
        if not far:
            return tuple(aside)
        text = f"reports {count(far, 'detection')} from beyond its range of {reach.range_m:.0f} m"
        return (*aside, SetAside(sensor, f"{text}: set aside", "beyond range"))

    def carried(self, name: str) -> None:
        """Record that asset `name` was carried elsewhere, so that its new position is plausible."""
        self._take(name, partial(self._carried, name))

    def _carried(self, name: str) -> None:
        heard = self._scene.station.heard[name]
        trust = PositionTrust(stood=heard.trust.stood, carried_tick=self._scene.tick)
        self._scene.station.heard[name] = heard._replace(trust=trust)

    def advance(self, tick: int, lag_s: float = 0.0) -> None:
        """Advance to `tick`, which is `lag_s` seconds behind the real time of the session.

        A station that was delayed does not catch up, but its assets have moved in the meantime.
        Therefore, the time that the station's clock has lost counts when the picture decides how
        far an asset can have moved since its last report.
        """
        self._scene.tick, self._lag_s = tick, lag_s

    def show(self, weather: Weather = "clear") -> tuple[str, ...]:
        """Rebuild the picture from the reports so far.

        Returns the senders of messages that were left out because they caused an error.
        """
        try:
            self._build(weather)
        except Exception:  # a message may corrupt the state; there must still be a picture
            return self._show_without_faults(weather)
        self._keep()
        return ()

    def _take(self, sender: str, take: Callable[[], T]) -> T:
        """Process a message with `take`, and remember it until the next picture.

        Errors of `take` are passed on.
        """
        result = take()
        self._taken.append((sender, take))
        return result

    def _keep(self) -> None:
        """Save the current state, from which a picture can be built."""
        self._good = (
            self._scene.copy(),
            dict(self._cameras),
            dict(self._recognised),
            dict(self._watched),
            dict(self._lags),
        )
        self._taken.clear()

    def _restore(self) -> None:
        tick = self._scene.tick
        scene, cameras, recognised, watched, lags = self._good
        self._scene = scene.copy()
        self._scene.tick, self._cameras = tick, dict(cameras)
        self._recognised, self._watched = dict(recognised), dict(watched)
        self._lags = dict(lags)

    def _show_without_faults(self, weather: Weather) -> tuple[str, ...]:
        """Process the messages since the last picture again, one by one, without the faulty ones.

        Returns the senders of the faulty messages.
        """
        taken, faulty = self._taken[:], list[str]()
        self._restore()
        self._taken.clear()
        for sender, take in taken:
            try:
                take()
                self._build(weather)
            except Exception:
                faulty.append(sender)
                self._restore()
            else:
                self._keep()
        try:
            self._build(weather)
        except Exception:  # the saved state is unusable as well: start without any report
            self.begin(self._scene.tick)
        self._keep()
        return tuple(faulty)

    def _build(self, weather: Weather) -> None:
        scene = self._scene
        silent_since = scene.tick - round(self.world.stale_s / self.world.dt_s)
        scene.sensing.weather = weather
        # A sensor without recent detections counts as broken. Otherwise, an asset beside it would
        # count as unseen, and its position as doubtful.
        scene.sensing.broken = (
            *(
                name
                for name in self.world.cameras
                if not (camera := self._cameras.get(name, (silent_since - 1, False)))[1]
                or camera[0] < silent_since
            ),
            *(name for name in scene.assets if self._watched.get(name, -math.inf) < silent_since),
        )
        integrity.compare(self.terrain, scene, self._seen())
        picture = station_side.build(self.terrain, scene, scene.assets).picture()
        update = {"links": dict(self.links), "not_ready": dict(self._not_ready)}
        self._picture = picture.model_copy(update=update)

    def note_readiness(self, name: str, why: str) -> None:
        """Set the reason why an asset cannot start yet, for the next picture; '' once it can."""
        if why:
            self._not_ready[name] = why
        else:
            self._not_ready.pop(name, None)

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Show `assets`, and no others, as under manual control in the next picture."""
        self._manual = assets
        for scene in (self._scene, self._good[0]):
            scene.station.manual = assets

    def picture(self) -> Picture:
        """Return the latest picture."""
        return self._picture

    def forecast(self) -> Checkpoint:
        """Return a simulation from the picture and the world only."""
        return Checkpoint.ahead_of(self.terrain, self.picture())

    def _seen(self) -> Mapping[str, Point]:
        """Return the recent positions at which other sensors recognised assets."""
        period_s = SEEN_PERIODS * self.world.telemetry_period_s
        recent = self._scene.tick - round(period_s / self.world.dt_s)
        return {name: at for name, (stamp, at) in self._recognised.items() if stamp >= recent}


def _unheard(name: str, terrain: Terrain) -> AssetTelemetry:
    """Return the telemetry of an asset that has never reported."""
    spec = terrain.world.assets[name]
    return AssetTelemetry(
        id=name,
        kind=spec.kind,
        at=None,
        post=None,
        position=terrain.world.frames[spec.post].at,
        heading_deg=0.0,
        speed_mps=0.0,
        status="ok",
        task="none",
        battery_pct=spec.battery_pct,
        low_battery=False,
        comms="lost",
        available=False,
        stale=True,
        stamp_s=0.0,
    )


def _detection(seen: ContactReport, stamp: int, dt_s: float) -> Detection:
    warned = None if seen.warned_s is None else stamp - round(seen.warned_s / dt_s)
    return Detection(
        contact=seen.signature,
        kind=seen.kind,
        position=seen.position,
        sigma_m=seen.sigma_m,
        identity=seen.identity,
        opinion=seen.opinion,
        noncombatants=seen.noncombatants,
        emergency=seen.emergency,
        warned_tick=warned,
    )
