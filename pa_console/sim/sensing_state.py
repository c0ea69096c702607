"""The state of sensing: contacts, detections, findings, tracks."""

import copy
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

from pa_console.schema.base import Point
from pa_console.schema.incident import Reaction
from pa_console.schema.telemetry import Identity, Intent, TrackStatus, Weather

ContactKind = Literal["vehicle", "person"]


@dataclass(slots=True)
class ContactState:
    """The true state of a vehicle or person outside the team; fields hold immutable values.

    On its lane it is `travelled` metres from the far end; off the lane, `route` has the remaining
    waypoints.
    """

    id: str
    kind: ContactKind
    gate: str
    lane: str
    travelled: float
    x: float
    y: float
    heading: float
    cruise_mps: float
    identity: Identity
    intent: Intent
    when_warned: Reaction = "leave"
    noncombatants: bool = False
    emergency: bool = False
    name: str | None = None
    speed: float = 0.0
    status: TrackStatus = "approaching"
    warned_tick: int | None = None
    on_lane: bool = True
    route: tuple[Point, ...] = ()

    @property
    def position(self) -> Point:
        """The position in metres."""
        return (self.x, self.y)


@dataclass(frozen=True, slots=True)
class Phantom:
    """A false contact, which one sensor reports until `until_tick`, although nothing is there."""

    id: str
    lane: str
    sensor: str
    from_tick: int
    until_tick: int


@dataclass(frozen=True, slots=True)
class Detection:
    """One sensor's observation of one contact in one report.

    `position` is a measurement, with a normal error of `sigma_m` on each axis, or None if it only
    repeats earlier knowledge. `contact` is the signature that associates detections of the same
    contact.
    """

    contact: str
    kind: ContactKind
    position: Point | None
    sigma_m: float
    identity: Identity = "unknown"
    opinion: Intent = "unknown"
    noncombatants: bool = False
    emergency: bool = False
    warned_tick: int | None = None


@dataclass(frozen=True, slots=True)
class ContactFinding:
    """A ground robot's finding from dealing with a contact (`identify`, `warn`).

    `identified_tick` is the tick of the identification, or None.
    """

    identity: Identity = "unknown"
    opinion: Intent = "unknown"
    warned_tick: int | None = None
    identified_tick: int | None = None


class Sighting(NamedTuple):
    """A sensor's latest detection of a contact: its tick and measured position."""

    sensor: str
    tick: int
    at: Point


@dataclass(frozen=True, slots=True)
class Statement:
    """The statement of one sensor on one contact: the latest value of each property, and its tick.

    `weight` is the weight of its vote. It last suspected noncombatants at `suspected_tick`, and
    last had the contact close by without suspecting any at `clear_tick`; -1 means never.
    """

    sensor: str
    weight: int
    identity: Identity = "unknown"
    identity_tick: int = -1
    opinion: Intent = "unknown"
    opinion_tick: int = -1
    suspected_tick: int = -1
    clear_tick: int = -1


@dataclass(slots=True)
class TrackFile:
    """The station's estimate from the detections of one contact.

    Position and velocity are estimates at `tick`; `variance`, `covariance` and `speed_variance` are
    their values on each axis. `identified`, `confirmed` and `suspected` are the identity, the
    intent and the suspicion of noncombatants that were known before the file began (in a forecast,
    from its picture). `statements` has each sensor's statement, sorted by sensor; `seen` has each
    sensor's latest detection. `anchor` and `anchor_tick` are the place and the time of the
    contact's last certain move.
    """

    id: str
    contact: str
    kind: ContactKind
    gate: str
    x: float
    y: float
    heading: float
    variance: float
    tick: int
    first_tick: int
    reviewed_tick: int = -1
    vx: float = 0.0
    vy: float = 0.0
    covariance: float = 0.0
    speed_variance: float = 0.0
    status: TrackStatus = "approaching"
    leaning: TrackStatus = "approaching"
    leaning_tick: int = 0
    anchor: Point | None = None
    anchor_tick: int = 0
    identified: Identity = "unknown"
    confirmed: Intent = "unknown"
    suspected: bool = False
    emergency: bool = False
    statements: tuple[Statement, ...] = ()
    seen: tuple[Sighting, ...] = ()
    observed: bool = False
    warned_tick: int | None = None
    warned_at: Point | None = None
    warned_sigma_m: float = 0.0
    warned_inside: bool = False
    defiant: bool = False

    @property
    def position(self) -> Point:
        """The estimated position at the last detection, in metres."""
        return (self.x, self.y)

    @property
    def sigma_m(self) -> float:
        """One standard deviation of the estimated position on each axis, in metres."""
        return self.variance**0.5


@dataclass(slots=True)
class SensingState:
    """The contacts, the condition and memory of the sensors, and the station's tracks.

    `named` maps a scenario's handles to contacts, including those that have left. Detections of
    `cleared` contacts that are still under way are ignored. `watched` counts the scans in which a
    sensor had a contact at close range.
    """

    contacts: dict[str, ContactState] = field(default_factory=dict[str, ContactState])
    spawned: int = 0
    named: dict[str, str] = field(default_factory=dict[str, str])
    cleared: tuple[str, ...] = ()
    weather: Weather = "clear"
    broken: tuple[str, ...] = ()
    phantoms: tuple[Phantom, ...] = ()
    watched: dict[tuple[str, str], int] = field(default_factory=dict[tuple[str, str], int])
    findings: dict[tuple[str, str], ContactFinding] = field(
        default_factory=dict[tuple[str, str], ContactFinding]
    )
    files: dict[str, TrackFile] = field(default_factory=dict[str, TrackFile])
    numbered: int = 0

    def copy(self) -> "SensingState":
        """Return an independent copy; immutable values are shared."""
        return replace(
            self,
            contacts={name: copy.copy(contact) for name, contact in self.contacts.items()},
            named=dict(self.named),
            watched=dict(self.watched),
            findings=dict(self.findings),
            files={name: copy.copy(file) for name, file in self.files.items()},
        )
