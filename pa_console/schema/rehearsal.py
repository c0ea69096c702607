"""The results of a plan's run in a forked simulation (step 5): its moments and the whole."""

from typing import Literal

from pydantic import Field

from pa_console.schema.base import Name, NonNegative, Percent, StrictModel
from pa_console.schema.command import Verb
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Identity, Intent, Picture, TrackStatus
from pa_console.schema.world import AssetKind


class TrackMoment(StrictModel):
    """The facts of a track that ordering rules use."""

    gate: Name
    kind: Literal["vehicle", "person"] = "vehicle"
    identity: Identity
    intent: Intent
    status: TrackStatus
    observed: bool
    warned: bool
    defiant: bool = False
    noncombatants: bool = Field(default=False, description="noncombatants are suspected (ROE-08)")
    emergency: bool = Field(default=False, description="an emergency vehicle (ROE-13)")
    ground_contact: bool = Field(
        default=False, description="a ground asset sent to it has it in sensor range"
    )
    too_near: bool = Field(
        default=False, description="a ground asset drives nearer to it within the standoff"
    )
    crowded: bool = Field(
        default=False,
        description="too near, by an asset without an order to identify or warn at its gate",
    )
    blocked: bool = Field(default=False, description="a UGV blocks its gate")
    block_ordered: bool = Field(
        default=False, description="a UGV blocks its gate, or is on its way to do so"
    )
    shut_in: bool = Field(
        default=False,
        description="it is inside, and a second gate or the last one is blocked or about to be",
    )
    followed: int = Field(
        default=0,
        ge=0,
        description="while an asset is on its way to it: how often assets were sent after it from "
        "one gate to another",
    )
    other_threat: bool = Field(default=False, description="another track at its gate is hostile")


class OrderMoment(StrictModel):
    """A command that is being carried out, or that is done."""

    agent: Name
    kind: AssetKind
    verb: Verb
    target: Name | None = None
    done: bool = False


class Moment(StrictModel):
    """The state at `time_s` (simulated seconds); moments that differ only in time count as one."""

    time_s: NonNegative
    tracks: dict[Name, TrackMoment] = {}
    covered: dict[Name, bool] = Field(default={}, description="gate -> known to be covered")
    up: dict[Name, bool] = Field(default={}, description="asset of the plan -> available")
    orders: tuple[OrderMoment, ...] = ()


class GateTimeline(StrictModel):
    """Cover of one gate during the plan; `longest_gap_s` is the longest time without any."""

    covered_before: bool
    covered_after: bool
    longest_gap_s: NonNegative


class TrackTimeline(StrictModel):
    """The first time of each event of a track, in seconds from the start; None means never."""

    observed_s: NonNegative | None = None
    ground_contact_s: NonNegative | None = Field(
        default=None, description="a ground asset sent by the plan came within its sensor range"
    )
    identified_s: NonNegative | None = None
    warned_s: NonNegative | None = None
    blocked_s: NonNegative | None = None
    least_distance_m: NonNegative | None = Field(
        default=None, description="closest approach of a ground asset while unidentified"
    )


class AssetTimeline(StrictModel):
    """The course of one addressed asset during the plan."""

    finished: bool = Field(description="its command ended as done")
    detail: str = Field(default="", description="why it did not finish")
    left_perimeter: bool = False
    entered_zones: tuple[Name, ...] = ()
    least_battery_pct: Percent = 100.0
    travelled_m: NonNegative = 0.0


class Timeline(StrictModel):
    """The rehearsed plan from its start to the end of its last command, or the horizon."""

    duration_s: NonNegative
    gates: dict[Name, GateTimeline]
    tracks: dict[Name, TrackTimeline] = {}
    assets: dict[Name, AssetTimeline] = {}


TimedPoint = tuple[NonNegative, float, float]
"""Seconds from the start of the plan, then metres east and metres north."""

GuardChange = tuple[NonNegative, tuple[Name, ...]]
"""Seconds from the start of the plan, and the assets that cover a gate from then on."""


class Motion(StrictModel):
    """The positions of assets and tracks during the plan, and the cover of each gate.

    All times are in seconds from the start. Between two points of a trajectory, the way is straight
    and the speed constant; an asset or track without a trajectory stood still.
    """

    trajectories: dict[Name, tuple[TimedPoint, ...]] = Field(
        default={}, description="asset or track -> its way, to within half a metre"
    )
    guards: dict[Name, tuple[GuardChange, ...]] = Field(
        default={}, description="gate -> its guards at the start and at each change"
    )
    arrived_s: dict[Name, NonNegative] = Field(
        default={}, description="addressed asset -> when it first reached its destination"
    )
    ended_s: dict[Name, NonNegative] = Field(
        default={}, description="addressed asset -> when its last command ended"
    )


class Rehearsal(StrictModel):
    """The result of a rehearsal; `after` is the picture at the end of the rehearsed plan.

    `motion` is empty in the log of an older console, and if nothing was rehearsed. `moments` are
    the rehearsal's states for ordering rules, without repetitions.
    """

    before: Picture
    after: Picture
    timeline: Timeline
    moments: tuple[Moment, ...] = ()
    motion: Motion = Motion()


class RehearsedReading(StrictModel):
    """The consequence of a reading: a plan for it and that plan's rehearsal."""

    plan: Plan
    rehearsal: Rehearsal
    faults: tuple[str, ...] = Field(default=(), description="why the plan cannot be approved")
