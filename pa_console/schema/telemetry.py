"""The common operational picture: the state of the checkpoint at one moment, as it is known."""

from typing import Literal

from pydantic import Field

from pa_console.schema.base import Name, NonNegative, Percent, Point, StrictModel
from pa_console.schema.world import AssetKind

AssetStatus = Literal["ok", "degraded", "failed"]
CommsStatus = Literal["ok", "degraded", "lost"]
Task = Literal[
    "idle", "holding", "moving", "observing", "identifying", "warning", "blocking", "returning",
    "charging", "none",
]  # fmt: skip
Identity = Literal["unknown", "authorized", "unauthorized"]
Intent = Literal["unknown", "benign", "hostile"]
IdentityClaim = Literal["authorized", "unauthorized", "hostile"]
"""A source's claim about a track's identity; `hostile` contradicts `authorized`."""
TrackStatus = Literal["approaching", "stopped", "leaving", "inside"]
Integrity = Literal["ok", "suspect"]
Weather = Literal["clear", "rain", "fog"]


class AssetTelemetry(StrictModel):
    """The latest report of one asset; `stamp_s` is the time of sending, in simulated seconds.

    `comms`, `stale`, `integrity` and `available` are the station's own conclusions from the reports
    that arrived and their times; the other fields are from the asset's report. `manual` is from the
    report as well, and is also true if an operator of this station has taken manual control.
    """

    id: Name
    kind: AssetKind
    at: Name | None = Field(description="frame that the asset is at; None between frames")
    post: Name | None = Field(description="frame to which the asset is assigned or heading")
    position: Point
    heading_deg: float = Field(description="0 east, 90 north")
    speed_mps: NonNegative
    status: AssetStatus
    task: Task
    battery_pct: Percent
    low_battery: bool
    comms: CommsStatus
    available: bool = Field(
        description="true if status is not failed, comms not lost, the battery not empty, the "
        "report fresh and sound, and the asset not under manual control"
    )
    stale: bool = Field(default=False, description="true if the report is too old to rely on")
    integrity: Integrity = Field(
        default="ok", description="suspect if the report contradicts physics or another sensor"
    )
    route: tuple[Point, ...] = Field(default=(), description="waypoints still ahead")
    command_id: str | None = None
    stamp_s: NonNegative
    manual: bool = Field(
        default=False,
        exclude_if=lambda manual: not manual,
        repr=False,
        description="true if a person drives it; the console then sends it only a stop's hold",
    )
    battery_known: bool = Field(
        default=True,
        exclude_if=lambda reported: reported,
        repr=False,
        description="false while it reports no battery charge, which then counts as low",
    )

    @property
    def charge(self) -> str:
        """The charge of the battery in words."""
        return f"{self.battery_pct:.0f} %" if self.battery_known else "unknown"


class Track(StrictModel):
    """A detected vehicle or person outside the team, as estimated from detections.

    `stamp_s` is the time of the last detection. `intent` is hostile only after two independent
    sensors have reported hostile intent (ROE-01, ROE-10); `hostile_by` names these sensors.
    `identity` is unknown while sources contradict each other, unless two or more of them outweigh
    the rest.
    """

    id: Name
    kind: Literal["vehicle", "person"]
    gate: Name = Field(description="the gate that it approaches or has reached")
    position: Point
    heading_deg: float
    speed_mps: NonNegative
    distance_m: NonNegative = Field(description="distance from its gate")
    identity: Identity = "unknown"
    intent: Intent = "unknown"
    status: TrackStatus = "approaching"
    observed_by: tuple[Name, ...] = Field(default=(), description="UAVs that see it now")
    observed: bool = Field(default=False, description="true once a UAV has seen it")
    warned: bool = False
    stamp_s: NonNegative
    first_seen_s: NonNegative = 0.0
    stale: bool = Field(
        default=False, description="true if the last detection is too old to rely on"
    )
    uncertainty_m: NonNegative = Field(
        default=0.0, description="standard deviation of the position"
    )
    seen_by: tuple[Name, ...] = Field(default=(), description="sensors that detect it now")
    hostile_by: tuple[Name, ...] = ()
    noncombatants: bool = Field(
        default=False, description="true if noncombatants are suspected (ROE-08)"
    )
    emergency: bool = Field(
        default=False,
        exclude_if=lambda marked: not marked,
        description="true if a sensor recognises an ambulance, a fire engine, or the police",
    )
    defiant: bool = Field(default=False, description="true if it continued after a warning")
    identity_claims: dict[Name, IdentityClaim] = Field(
        default={},
        exclude_if=lambda claims: not claims,
        description="each source's claim about its identity, while the claims are contradictory",
    )

    @property
    def dispute(self) -> str:
        """The claims about the identity in words; '' if the identity is not disputed."""
        claims = ", ".join(f"{name} says {claim}" for name, claim in self.identity_claims.items())
        return f"identity disputed: {claims}" if claims else ""


class CameraReport(StrictModel):
    """The condition of a gate's camera, reported over its own link."""

    gate: Name
    works: bool
    stamp_s: NonNegative


class GateCover(StrictModel):
    """The cover of a gate: the assets that cover it, and the time for which it had no cover.

    `unsure` are assets whose last report places them at the gate but is stale or suspect. If no
    other asset is at the gate, its cover is unknown, and it counts as uncovered.
    """

    covered: bool
    by: tuple[Name, ...] = ()
    uncovered_s: NonNegative = 0.0
    unsure: tuple[Name, ...] = ()

    @property
    def unknown(self) -> bool:
        """True if it is unknown whether the gate is covered."""
        return not self.covered and bool(self.unsure)


class Picture(StrictModel):
    """The common operational picture at `time_s`: assets, tracks and gate cover by name."""

    tick: int
    time_s: NonNegative
    assets: dict[Name, AssetTelemetry]
    tracks: dict[Name, Track] = {}
    gates: dict[Name, GateCover]
    cameras: dict[Name, CameraReport] = {}
    weather: Weather = "clear"
    links: dict[Name, str] = Field(
        default={},
        exclude_if=lambda links: not links,
        description="asset -> its link; empty for a fleet without links",
    )
    not_ready: dict[Name, str] = Field(
        default={},
        exclude_if=lambda why: not why,
        description="asset -> why it cannot start yet, such as checks before arming",
    )


class Selection(StrictModel):
    """The part of the picture that is in a prompt, with the reason for each item."""

    gates: dict[Name, str] = Field(description="gate -> why it matters")
    tracks: dict[Name, str] = {}
    assets: dict[Name, str] = Field(description="asset -> why it matters")
    frames: tuple[Name, ...] = Field(default=(), description="the frames that a plan may name")
    left_out: dict[Literal["gates", "tracks", "assets"], int] = {}


class Digest(StrictModel):
    """The picture as the models see it (step 3), with the facts that an operator would want."""

    covered: dict[Name, int] = Field(description="number of assets covering each gate")
    uncovered: tuple[Name, ...]
    free: dict[AssetKind, tuple[Name, ...]] = Field(
        description="assets that may leave their place without uncovering a gate, best first"
    )
    sole_cover: dict[Name, Name] = Field(description="gate -> the only asset that covers it")
    posts: dict[Name, str] = Field(description="available asset -> 'kind at frame, task'")
    down: tuple[Name, ...]
    stood: dict[Name, Name] = Field(
        default_factory=dict[Name, Name], description="asset that is down -> the gate it covered"
    )
    unknown: tuple[str, ...] = Field(
        default=(), description="one line for each gate or asset without fresh data"
    )
    low_battery: tuple[Name, ...]
    degraded_comms: tuple[Name, ...] = ()
    tracks: tuple[str, ...] = Field(description="one line per track, nearest first")
    selection: Selection | None = Field(
        default=None, description="the part of the picture; None if all of it is included"
    )
