"""One moment of a mission as ordering rules see it: who is what, who does what, nothing more."""

from pydantic import Field

from pa_console.schema.base import Name, NonNegative, StrictModel
from pa_console.schema.command import Verb
from pa_console.schema.telemetry import Identity, Intent, TrackStatus
from pa_console.schema.world import AssetKind


class TrackMoment(StrictModel):
    """The facts of a track that ordering rules use."""

    gate: Name
    identity: Identity
    intent: Intent
    status: TrackStatus
    observed: bool
    warned: bool
    defiant: bool = False
    noncombatants: bool = Field(default=False, description="noncombatants are suspected (ROE-08)")
    ground_contact: bool = Field(
        default=False, description="a ground asset sent to it has it in sensor range"
    )
    too_near: bool = Field(
        default=False, description="a ground asset drives nearer to it within the standoff"
    )
    blocked: bool = Field(default=False, description="a UGV blocks its gate")
    other_threat: bool = Field(default=False, description="another track at its gate is hostile")


class OrderMoment(StrictModel):
    """A command under way or done."""

    agent: Name
    kind: AssetKind
    verb: Verb
    target: Name | None = None
    done: bool = False


class Moment(StrictModel):
    """The state at `time_s`, simulated seconds; two equal but for the time count as one."""

    time_s: NonNegative
    tracks: dict[Name, TrackMoment] = {}
    covered: dict[Name, bool] = Field(default={}, description="gate -> known to be covered")
    up: dict[Name, bool] = Field(default={}, description="asset of the plan -> available")
    orders: tuple[OrderMoment, ...] = ()
