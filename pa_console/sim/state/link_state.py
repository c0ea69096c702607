"""The state of radio and trust: messages on their way, and reports at the station."""

from dataclasses import dataclass, field
from typing import NamedTuple

from pa_console.schema.base import Point
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.telemetry import AssetTelemetry, GateCover
from pa_console.schema.world import Radio
from pa_console.sim.state.sensing_state import Detection


@dataclass(frozen=True, slots=True)
class RadioState:
    """The condition of one asset's link; with `up` False nothing passes either way."""

    latency_s: float
    jitter_s: float
    loss: float
    up: bool = True

    @classmethod
    def nominal(cls, radio: Radio) -> "RadioState":
        """Return the link as the world has it while nothing disturbs it."""
        return cls(radio.latency_s, radio.jitter_s, radio.loss)


UNDISTURBED = RadioState(latency_s=0.0, jitter_s=0.0, loss=0.0)


@dataclass(frozen=True, slots=True)
class Jam:
    """An area in which no link works, until a tick or for good."""

    at: Point
    radius_m: float
    until_tick: int | None


@dataclass(frozen=True, slots=True)
class Drift:
    """An asset's own idea of its position drifts away from the truth by (vx, vy) m/s."""

    vx: float
    vy: float
    since_tick: int

    def applied(self, position: Point, tick: int, dt_s: float) -> Point:
        """Return where an asset that truly is at `position` believes to be at `tick`."""
        seconds = (tick - self.since_tick) * dt_s
        return (position[0] + self.vx * seconds, position[1] + self.vy * seconds)


@dataclass(slots=True, repr=False, eq=False)
class Said:
    """An asset's own report: as an earlier one, `like`, but for battery and time.

    The telemetry itself is put together when it is read; `repr` shows that.
    """

    like: AssetTelemetry
    battery_pct: float
    stamp_s: float
    _telemetry: AssetTelemetry | None = None

    @classmethod
    def of(cls, telemetry: AssetTelemetry) -> "Said":
        """Return `telemetry` as a report."""
        return cls(telemetry, telemetry.battery_pct, telemetry.stamp_s, telemetry)

    def telemetry(self) -> AssetTelemetry:
        """Return the whole report."""
        if self._telemetry is None:
            new = {"battery_pct": self.battery_pct, "stamp_s": self.stamp_s}
            self._telemetry = AssetTelemetry.of_valid({**self.like.__dict__, **new})
        return self._telemetry

    def __repr__(self) -> str:
        """Return what the telemetry looks like."""
        return repr(self.telemetry())


class Report(NamedTuple):
    """One telemetry message: what an asset said of itself at tick `stamp`, and what it detected."""

    agent: str
    stamp: int
    telemetry: Said
    detections: tuple[Detection, ...] = ()


@dataclass(slots=True)
class LinkState:
    """Messages under way: commands and replies as (tick due, order of sending, message).

    `latest_due` holds, per direction and device, when the latest message is due: the next one is
    not due sooner. Reports keep no order; they stand under the tick at which they are due.
    """

    sent: int = 0
    commands: tuple[tuple[int, int, DeviceCommand], ...] = ()
    replies: tuple[tuple[int, int, CommandReply], ...] = ()
    reports: dict[int, list[Report]] = field(default_factory=dict[int, list[Report]])
    latest_due: dict[tuple[str, str], int] = field(default_factory=dict[tuple[str, str], int])
    jams: tuple[Jam, ...] = ()

    def copy(self) -> "LinkState":
        """Return an independent copy; messages are immutable."""
        return LinkState(
            sent=self.sent,
            commands=self.commands,
            replies=self.replies,
            reports={due: list(reports) for due, reports in self.reports.items()},
            latest_due=dict(self.latest_due),
            jams=self.jams,
        )


@dataclass(frozen=True, slots=True)
class Trust:
    """The station's trust in the positions that one asset reports; see integrity.py.

    `stood` is where it came to stand, by sound reports. While it is `suspect`, `anchor` is its last
    sound position, of tick `anchor_tick`, `lie` a place where other sensors miss it, and
    `sound_from` the tick since which its reports have been sound again. `unseen` and `seen` count
    in a row the periods in which other sensors missed it, or saw it, at its reported place. Reports
    sent up to `carried_tick` are void: it was carried elsewhere then.
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

    `marks` has one bit for each of the last expected reports, the latest lowest: 1 if it came in
    time.
    """

    telemetry: Said
    stamp: int
    marks: int
    trust: Trust = Trust()


@dataclass(slots=True)
class StationState:
    """The station's side: what it heard of each asset, what it concluded, and the gates' cover.

    `shown` is what the picture says of each asset; `at_gate` names, per gate, who is posted to it
    and at it, and whether that is sure. `covered_tick` is when a gate was last known to be covered.
    """

    heard: dict[str, Heard] = field(default_factory=dict[str, Heard])
    shown: dict[str, Said] = field(default_factory=dict[str, Said])
    at_gate: dict[str, dict[str, bool]] = field(default_factory=dict[str, dict[str, bool]])
    covers: dict[str, GateCover] = field(default_factory=dict[str, GateCover])
    covered_tick: dict[str, int] = field(default_factory=dict[str, int])

    def copy(self) -> "StationState":
        """Return an independent copy; reports and covers are immutable."""
        return StationState(
            heard=dict(self.heard),
            shown=dict(self.shown),
            at_gate={gate: dict(names) for gate, names in self.at_gate.items()},
            covers=dict(self.covers),
            covered_tick=dict(self.covered_tick),
        )
