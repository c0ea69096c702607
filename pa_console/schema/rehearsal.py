"""The results of a plan's rehearsal in a forecast (step 5): single moments and the whole run."""

from typing import Literal

from pydantic import Field

from pa_console.schema.base import Name, NonNegative, Percent, StrictModel
from pa_console.schema.command import Verb
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Identity, Intent, Picture, TrackStatus
from pa_console.schema.world import AssetKind


class TrackMoment(StrictModel):
    """The facts about a track, at one moment, that ordering rules use."""

    gate: Name
    kind: Literal["vehicle", "person"] = "vehicle"
    identity: Identity
    intent: Intent
    status: TrackStatus
    observed: bool
    warned: bool
    defiant: bool = False
    noncombatants: bool = Field(
        default=False, description="true if noncombatants are suspected (ROE-08)"
    )
    emergency: bool = Field(default=False, description="true for an emergency vehicle (ROE-13)")
    ground_contact: bool = Field(
        default=False,
        description="true if a ground asset that is sent to it has it in sensor range",
    )
    too_near: bool = Field(
        default=False, description="true if a ground asset within the standoff drives nearer to it"
    )
    crowded: bool = Field(
        default=False,
        description="true if an asset without an order to identify or warn at its gate is too near",
    )
    blocked: bool = Field(default=False, description="true if a UGV blocks its gate")
    block_ordered: bool = Field(
        default=False, description="true if a UGV blocks its gate or is on its way to do so"
    )
    shut_in: bool = Field(
        default=False,
        description="true if it is inside, and a second gate or the last gate is blocked or about "
        "to be blocked",
    )
    followed: int = Field(
        default=0,
        ge=0,
        description="how often assets were sent after it from one gate to another, while an asset "
        "is on its way to it",
    )
    other_threat: bool = Field(
        default=False, description="true if another track at its gate is hostile"
    )


class OrderMoment(StrictModel):
    """A command that an agent is carrying out, or has carried out."""

    agent: Name
    kind: AssetKind
    verb: Verb
    target: Name | None = None
    done: bool = False


class Moment(StrictModel):
    """The state at `time_s` in simulated seconds; moments that differ only in time are merged."""

    time_s: NonNegative
    tracks: dict[Name, TrackMoment] = {}
    covered: dict[Name, bool] = Field(
        default={}, description="gate -> whether it is known to be covered"
    )
    up: dict[Name, bool] = Field(
        default={}, description="asset of the plan -> whether it is available"
    )
    orders: tuple[OrderMoment, ...] = ()


class GateTimeline(StrictModel):
    """The cover of one gate during the plan; `longest_gap_s` is its longest time without cover."""

    covered_before: bool
    covered_after: bool
    longest_gap_s: NonNegative


class TrackTimeline(StrictModel):
    """The first time of each event of a track, in seconds from the start; None for never."""

    observed_s: NonNegative | None = None
    ground_contact_s: NonNegative | None = Field(
        default=None,
        description="a ground asset that the plan sent came within its own sensor range",
    )
    identified_s: NonNegative | None = None
    warned_s: NonNegative | None = None
    blocked_s: NonNegative | None = None
    least_distance_m: NonNegative | None = Field(
        default=None, description="closest approach of a ground asset before identification"
    )


class AssetTimeline(StrictModel):
    """The course of one agent during the plan."""

    finished: bool = Field(description="true if its command ended as done")
    detail: str = Field(default="", description="why its command did not end as done")
    left_perimeter: bool = False
    entered_zones: tuple[Name, ...] = ()
    least_battery_pct: Percent = 100.0
    travelled_m: NonNegative = 0.0


class Timeline(StrictModel):
    """The rehearsed plan from its start to the end of its last command, or to the time limit."""

    duration_s: NonNegative
    gates: dict[Name, GateTimeline]
    tracks: dict[Name, TrackTimeline] = {}
    assets: dict[Name, AssetTimeline] = {}


TimedPoint = tuple[NonNegative, float, float]
"""The seconds from the start of the plan, and a position in metres east and north."""

GuardChange = tuple[NonNegative, tuple[Name, ...]]
"""The seconds from the start of the plan, and the assets that cover a gate from then on."""


class Motion(StrictModel):
    """The positions of assets and tracks during the plan, and the cover of each gate.

    All times are in seconds from the start. Between two points of a trajectory, the way is straight
    and the speed constant. An asset or track without a trajectory stood still.
    """

    trajectories: dict[Name, tuple[TimedPoint, ...]] = Field(
        default={}, description="asset or track -> its way, within half a metre"
    )
    guards: dict[Name, tuple[GuardChange, ...]] = Field(
        default={}, description="gate -> its guards at the start and at each change"
    )
    arrived_s: dict[Name, NonNegative] = Field(
        default={}, description="agent -> when it reached its destination"
    )
    ended_s: dict[Name, NonNegative] = Field(
        default={}, description="agent -> when its last command ended"
    )


class Rehearsal(StrictModel):
    """The result of a rehearsal; `after` is the picture at the end of the rehearsed plan.

    `motion` is empty in the log of an older console, and if no motion was simulated. `moments` are
    the states of the rehearsal that ordering rules use, without repetitions.
    """

    before: Picture
    after: Picture
    timeline: Timeline
    moments: tuple[Moment, ...] = ()
    motion: Motion = Motion()


class RehearsedReading(StrictModel):
    """The consequence of a reading: a plan for it, and the rehearsal of that plan."""

    plan: Plan
    rehearsal: Rehearsal
    faults: tuple[str, ...] = Field(default=(), description="why the plan cannot be approved")
