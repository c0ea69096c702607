"""The dynamic state of a simulated checkpoint: everything that a fork copies and a hash covers.

A battery is updated only when its rate changes or it is reported, so that idle assets cost no time
in between (CAP-04).
"""

import copy
import hashlib
import math
import random
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import NamedTuple

from pa_console.schema.base import Point
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Task
from pa_console.schema.world import AssetKind, Radio, Wall, World
from pa_console.sim.sensing_state import ContactState, Detection, SensingState

_index = attrgetter("index")


@dataclass(frozen=True, slots=True)
class RadioState:
    """The condition of one asset's link; if `up` is False, nothing passes either way."""

    latency_s: float
    jitter_s: float
    loss: float
    up: bool = True

    @classmethod
    def nominal(cls, radio: Radio) -> "RadioState":
        """Return the undisturbed link of the world."""
        return cls(radio.latency_s, radio.jitter_s, radio.loss)


UNDISTURBED = RadioState(latency_s=0.0, jitter_s=0.0, loss=0.0)


@dataclass(frozen=True, slots=True)
class Jam:
    """An area in which no link works, until a tick or permanently."""

    at: Point
    radius_m: float
    until_tick: int | None


@dataclass(frozen=True, slots=True)
class Drift:
    """The drift of an asset's own position estimate away from the truth, by (vx, vy) m/s."""

    vx: float
    vy: float
    since_tick: int

    def applied(self, position: Point, tick: int, dt_s: float) -> Point:
        """Return the estimate that an asset at `position` has of its position at `tick`."""
        seconds = (tick - self.since_tick) * dt_s
        return (position[0] + self.vx * seconds, position[1] + self.vy * seconds)


@dataclass(slots=True, repr=False, eq=False)
class SelfReport:
    """An asset's own report: equal to the report `like` except for battery and time.

    The telemetry is assembled when it is read; `repr` shows it.
    """

    like: AssetTelemetry
    battery_pct: float
    stamp_s: float
    _telemetry: AssetTelemetry | None = None

    @classmethod
    def of(cls, telemetry: AssetTelemetry) -> "SelfReport":
        """Return `telemetry` as a report."""
        return cls(telemetry, telemetry.battery_pct, telemetry.stamp_s, telemetry)

    def telemetry(self) -> AssetTelemetry:
        """Return the whole report."""
        if self._telemetry is None:
            new = {"battery_pct": self.battery_pct, "stamp_s": self.stamp_s}
            self._telemetry = AssetTelemetry.of_valid({**self.like.__dict__, **new})
        return self._telemetry

    def __repr__(self) -> str:
        """Return the `repr` of the telemetry."""
        return repr(self.telemetry())


class Report(NamedTuple):
    """One telemetry message: an asset's own report and its detections at tick `stamp`."""

    agent: str
    stamp: int
    telemetry: SelfReport
    detections: tuple[Detection, ...] = ()
    held_up_s: float = 0.0
    """Seconds since the asset's last report during which the station's clock was stopped."""


@dataclass(slots=True)
class LinkState:
    """Messages under way: commands and replies as (tick due, order of sending, message).

    `latest_due` has, by direction and device, the tick at which the latest message is due; the next
    message is not due before it. Reports have no order; they are stored by the tick at which they
    are due.
    """

    sent: int = 0
    commands: tuple[tuple[int, int, DeviceCommand], ...] = ()
    replies: tuple[tuple[int, int, CommandReply], ...] = ()
    reports: dict[int, list[Report]] = field(default_factory=dict[int, list[Report]])
    latest_due: dict[tuple[str, str], int] = field(default_factory=dict[tuple[str, str], int])
    jams: tuple[Jam, ...] = ()

    def copy(self) -> "LinkState":
        """Return an independent copy; messages are immutable."""
        reports = {due: list(reports) for due, reports in self.reports.items()}
        return replace(self, reports=reports, latest_due=dict(self.latest_due))


@dataclass(frozen=True, slots=True)
class PositionTrust:
    """The station's trust in the positions that one asset reports; see integrity.py.

    `stood` is the place where it stopped, according to sound reports. While it is `suspect`,
    `anchor` is its last sound position, at tick `anchor_tick`; `lie` is a reported place at which
    other sensors did not see it; and `sound_from` is the tick since which its reports have been
    sound again. `unseen` and `seen` count the consecutive periods in which other sensors missed or
    saw it at its reported place. Reports sent up to `carried_tick` are void, because the asset was
    moved then.
    """

    stood: Point | None = None
    suspect: bool = False
    anchor: Point = (0.0, 0.0)
    anchor_tick: int = 0
    lie: Point | None = None
    sound_from: int | None = None
    unseen: int = 0
    seen: int = 0
    carried_tick: int | None = None


class Heard(NamedTuple):
    """The station's record of one asset: its latest report, sent at tick `stamp`, and the link.

    `marks` has one bit for each of the last expected reports, the latest lowest: 1 if it arrived in
    time.
    """

    telemetry: SelfReport
    stamp: int
    marks: int
    trust: PositionTrust = PositionTrust()


@dataclass(slots=True)
class StationState:
    """The station's side: reports of each asset, conclusions from them, and the gates' cover.

    `shown` has the reports in the picture. `at_gate` maps each gate to the assets that are posted
    to it and have arrived, each with True if its presence is certain. `covered_tick` is the tick at
    which a gate was last known to be covered; `manual` has the assets under manual control by the
    station's own record.
    """

    heard: dict[str, Heard] = field(default_factory=dict[str, Heard])
    shown: dict[str, SelfReport] = field(default_factory=dict[str, SelfReport])
    at_gate: dict[str, dict[str, bool]] = field(default_factory=dict[str, dict[str, bool]])
    covers: dict[str, GateCover] = field(default_factory=dict[str, GateCover])
    covered_tick: dict[str, int] = field(default_factory=dict[str, int])
    manual: frozenset[str] = field(default=frozenset(), repr=False)

    def copy(self) -> "StationState":
        """Return an independent copy; reports and covers are immutable."""
        return replace(
            self,
            heard=dict(self.heard),
            shown=dict(self.shown),
            at_gate={gate: dict(names) for gate, names in self.at_gate.items()},
            covers=dict(self.covers),
            covered_tick=dict(self.covered_tick),
        )


@dataclass(slots=True)
class ScriptState:
    """The progress of a scenario; its random events are drawn from `seed`.

    `due_s` is the time of a scripted event, which is known once the event's condition has held;
    `happened` and `skipped` list the events that are over. `drawn` counts the random events of each
    process, and `next_s` has the time of its next event. Events and processes are identified by
    their index.
    """

    seed: int = 0
    due_s: dict[int, float] = field(default_factory=dict[int, float])
    happened: tuple[int, ...] = ()
    skipped: tuple[int, ...] = ()
    drawn: tuple[int, ...] = ()
    next_s: tuple[float, ...] = ()

    def copy(self) -> "ScriptState":
        """Return an independent copy."""
        return replace(self, due_s=dict(self.due_s))


@dataclass(slots=True)
class AssetState:
    """The true state of one asset; fields hold immutable values, so a shallow copy is enough.

    `station` is the place where the asset stands or will stand, `route` the remaining waypoints,
    `origin` the start of the present leg; `obstructions` are those that the asset has detected.
    `nearest_m` is the shortest remaining way so far, reached at `nearest_tick`; `stalls` counts how
    often the asset got stuck on the leg. `heard_tick` is the tick of the last message from the
    station; while the asset is `cut_off`, `owes` has the replies about the end of its command.
    While it is `manual`, a person drives it; while it is `plugged_in`, its battery stays full.
    `place` is the frame of the position `placed_at`; `battery` is the charge at `settled_tick`.
    `last_telemetry` is the asset's last report, or None if more than the battery may have changed
    since; it follows from the other fields, so the hash leaves it out.
    """

    id: str
    kind: AssetKind
    index: int
    x: float
    y: float
    heading: float
    battery: float
    post: str | None
    station: Point
    radio: RadioState = UNDISTURBED
    task: Task = "idle"
    speed: float = 0.0
    speed_factor: float = 1.0
    failed: bool = False
    heard_tick: int = 0
    cut_off: bool = False
    owes: tuple[CommandReply, ...] = ()
    drift: Drift | None = None
    spoofed: str | None = None
    manual: bool = field(default=False, repr=False)
    plugged_in: bool = field(default=False, repr=False)
    settled_tick: int = 0
    place: str | None = None
    placed_at: Point | None = None
    obstructions: tuple[Wall, ...] = ()
    command: DeviceCommand | None = None
    origin: Point = (0.0, 0.0)
    route: tuple[Point, ...] = ()
    nearest_m: float = math.inf
    nearest_tick: int = 0
    stalls: int = 0
    held_by: str = ""
    dwell: int = 0
    announced: bool = False
    progress_tick: int = 0
    answered: tuple[CommandReply, ...] = ()
    last_telemetry: AssetTelemetry | None = field(default=None, repr=False, compare=False)

    @property
    def position(self) -> Point:
        """The position in metres."""
        return (self.x, self.y)

    @property
    def down(self) -> bool:
        """True if the asset cannot act, because it has failed or its battery is empty."""
        return self.failed or self.battery <= 0.0

    def stop(self, task: Task) -> None:
        """Stop the asset where it is, and set its `task`."""
        self.route, self.speed, self.task = (), 0.0, task
        self.station, self.held_by = self.position, ""


@dataclass(slots=True)
class Scene:
    """The whole dynamic state: the truth, and in `station` the part that has reached the station.

    `covered_tick` is the tick at which a gate was last truly covered. `active` has the names of the
    assets that every step processes; idle assets are skipped. In an `ideal` scene, used for a
    forecast, messages are never lost and assets report only changes: `touched` has the names of
    assets that were active since the last picture.
    """

    rng: random.Random
    tick: int = 0
    assets: dict[str, AssetState] = field(default_factory=dict[str, AssetState])
    link: LinkState = field(default_factory=LinkState)
    sensing: SensingState = field(default_factory=SensingState)
    script: ScriptState = field(default_factory=ScriptState)
    obstructions: tuple[Wall, ...] = ()
    station: StationState = field(default_factory=StationState)
    covered_tick: dict[str, int] = field(default_factory=dict[str, int])
    active: set[str] = field(default_factory=set[str])
    ideal: bool = False
    touched: set[str] = field(default_factory=set[str])

    def busy(self) -> list[AssetState]:
        """Return the assets that every step processes, in the team's order."""
        return self.in_order(self.active)

    def in_order(self, names: Iterable[str]) -> list[AssetState]:
        """Return the assets `names` in the team's order."""
        return sorted([self.assets[name] for name in names], key=_index)

    @property
    def contacts(self) -> dict[str, ContactState]:
        """The true state of vehicles and persons outside the team."""
        return self.sensing.contacts

    def copy(self) -> "Scene":
        """Return an independent copy; immutable messages and reports are shared."""
        rng = random.Random()
        rng.setstate(self.rng.getstate())
        return replace(
            self,
            rng=rng,
            assets={name: copy.copy(asset) for name, asset in self.assets.items()},
            link=self.link.copy(),
            sensing=self.sensing.copy(),
            script=self.script.copy(),
            station=self.station.copy(),
            covered_tick=dict(self.covered_tick),
            active=set(self.active),
            touched=set(self.touched),
        )

    def digest(self) -> str:
        """Return the SHA-256 over every field, with exact floats and sorted sets."""
        unordered = self.sensing.broken, self.sensing.cleared
        sensing = replace(self.sensing, broken=frozenset(), cleared=frozenset())
        parts = (
            self.rng.getstate(), self.tick, self.assets, self.link, sensing, self.script,
            self.obstructions, self.station, self.covered_tick, sorted(self.active), self.ideal,
            sorted(self.touched), *map(sorted, unordered),
        )  # fmt: skip
        driven = sorted(name for name, asset in self.assets.items() if asset.manual)
        if driven or self.station.manual:
            parts = (*parts, driven, sorted(self.station.manual))
        if plugged_in := sorted(name for name, asset in self.assets.items() if asset.plugged_in):
            parts = (*parts, "plugged in", plugged_in)
        return hashlib.sha256(repr(parts).encode()).hexdigest()


def rouse(world: World, scene: Scene, asset: AssetState) -> None:
    """Add `asset` to the assets that every step processes, until it is idle again."""
    settle_battery(world, scene, asset)
    scene.active.add(asset.id)
    asset.last_telemetry = None


def settle_battery(world: World, scene: Scene, asset: AssetState) -> None:
    """Update the battery to the present tick.

    A charging asset gains charge until it is full; then it is idle, and stays full until it moves.
    """
    minutes = (scene.tick - asset.settled_tick) * world.dt_s / 60.0
    asset.settled_tick = scene.tick
    before = asset.battery
    if minutes <= 0.0 or asset.failed or before <= 0.0:
        return
    platform = world.platforms[asset.kind]
    if asset.task == "charging":
        asset.battery = min(100.0, before + platform.charge_pct_per_min * minutes)
        if asset.battery >= 100.0:
            asset.task, asset.last_telemetry, asset.plugged_in = "idle", None, True
        return
    moving = asset.speed > 0.0
    asset.plugged_in = asset.plugged_in and not moving
    if asset.plugged_in:
        return
    rate = platform.drain_moving_pct_per_min if moving else platform.drain_idle_pct_per_min
    after = before - rate * minutes
    if after > 0.0:
        asset.battery = after
        return
    asset.battery, asset.last_telemetry = 0.0, None
    scene.active.add(asset.id)
