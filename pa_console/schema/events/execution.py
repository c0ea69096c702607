"""Events of steps 8 to 10: commands, halts, verifications, reports, stops and manual control."""

from typing import ClassVar, Literal

from pydantic import Field

from pa_console.schema.base import Name, Payload
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.finding import Usage, Verdict
from pa_console.schema.mission import Metrics, MissionStatus, Verification


class CommandSent(Payload):
    """Step 8: a command went out on the link."""

    binding: ClassVar[bool] = True

    kind: Literal["command_sent"] = "command_sent"
    command: DeviceCommand


class CommandRefused(Payload):
    """Step 8: the command gate refused a command, with the reason."""

    binding: ClassVar[bool] = True
    kind: Literal["command_refused"] = "command_refused"
    command: DeviceCommand
    reason: str


class CommandResent(Payload):
    """Step 8: an unanswered command was sent again with the same id."""

    kind: Literal["command_resent"] = "command_resent"
    command_id: str
    times: int


class PlanHalted(Payload):
    """Step 8: the running plan was halted, and assets were sent their way to safety."""

    kind: Literal["plan_halted"] = "plan_halted"
    attempt: int
    reasons: tuple[str, ...]
    safe_state: tuple[str, ...] = Field(
        default=(), description="the commands that were sent: agent and command"
    )


class StepsHeld(Payload):
    """Step 8: actions of an approved plan that will not be sent, with the reason."""

    kind: Literal["steps_held"] = "steps_held"
    attempt: int
    orders: tuple[str, ...] = Field(description="the unsent actions: agent and command")
    reason: str


class StepsPaused(Payload):
    """Step 8: a mission was paused before its next step, or resumed."""

    kind: Literal["steps_paused"] = "steps_paused"
    paused: bool
    by: str


class CommandReplied(Payload):
    """Step 8: a device's reply, or `failed` after a time-out."""

    kind: Literal["command_replied"] = "command_replied"
    reply: CommandReply


class MissionVerified(Payload):
    """Step 9: the outcome of the executed plan, according to telemetry."""

    kind: Literal["mission_verified"] = "mission_verified"
    verification: Verification
    seconds: float
    step: int = Field(
        default=0,
        exclude_if=lambda step: not step,
        description="the number of the plan's step, from 1; 0 for a plan of one step",
    )


class OutcomeJudged(Payload):
    """Step 9: the judge's verdict on the outcome of an executed plan, or why there is no verdict.

    Nothing waits for the verdict: it may come after other plans, or after the mission's end.
    """

    kind: Literal["outcome_judged"] = "outcome_judged"
    attempt: int | None = Field(
        default=None, description="the plan's number; None for the last verified plan"
    )
    verdict: Verdict | None
    error: str = ""
    usage: Usage = Usage()


class MissionReported(Payload):
    """Step 10: the brief after-action report (WF-09)."""

    kind: Literal["mission_reported"] = "mission_reported"
    text: str


class MissionFinished(Payload):
    """The mission has ended."""

    kind: Literal["mission_finished"] = "mission_finished"
    status: MissionStatus
    reason: str
    metrics: Metrics


class AllStopped(Payload):
    """The operator's stop: every asset is ordered to hold, and open plans become void.

    Until the next `StopReleased`, no command except hold and report leaves the station.
    """

    binding: ClassVar[bool] = True

    kind: Literal["all_stopped"] = "all_stopped"
    by: str


class ManualControlTaken(Payload):
    """An operator has taken manual control of an asset: the console sends it only a stop's hold.

    The event stays in effect after a restart of the console.
    """

    binding: ClassVar[bool] = True
    kind: Literal["manual_control_taken"] = "manual_control_taken"
    asset: Name
    by: str


class ManualControlEnded(Payload):
    """An operator has ended manual control of an asset; this resumes no plan."""

    binding: ClassVar[bool] = True
    kind: Literal["manual_control_ended"] = "manual_control_ended"
    asset: Name
    by: str


class MissionAwaitsAssets(Payload):
    """A mission ended unfinished because `assets` are under manual control.

    Once manual control of all these assets has ended, the mission's words are queued as the new
    mission `again`, which is planned, checked and approved like any other.
    """

    kind: Literal["mission_awaits_assets"] = "mission_awaits_assets"
    assets: tuple[Name, ...]
    again: str = Field(default="", description="the mission that replaces it; '' while it waits")


class StopUnconfirmed(Payload):
    """The assets that are not known to hold after a stop, each with the reason.

    If `assets` is empty, all assets are known to hold.
    """

    kind: Literal["stop_unconfirmed"] = "stop_unconfirmed"
    assets: dict[Name, str]


class StopReleased(Payload):
    """The operator has released the stop, so missions and alarms are processed again."""

    binding: ClassVar[bool] = True
    kind: Literal["stop_released"] = "stop_released"
    by: str
