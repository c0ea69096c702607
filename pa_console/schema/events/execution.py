"""Events of steps 8 to 10: commands, halts, verification, report, stop."""

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
    """Step 8: the command gate refused a command without a decision, or during a stop."""

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
    """Step 8: a premise of the running plan broke; each asset is sent its way to safety."""

    kind: Literal["plan_halted"] = "plan_halted"
    attempt: int
    reasons: tuple[str, ...]
    safe_state: tuple[str, ...] = Field(default=(), description="the command to each asset")


class StepsHeld(Payload):
    """Step 8: actions of an approved plan that are not sent because of earlier actions."""

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
        description="the step of the plan, counted from 1; 0 for a plan of one step",
    )


class OutcomeJudged(Payload):
    """Step 9: the judge's verdict on the outcome of an executed plan, or why there is none.

    Nothing waits for it: it may come after other plans of the mission, and after the mission's end.
    """

    kind: Literal["outcome_judged"] = "outcome_judged"
    attempt: int | None = Field(
        default=None, description="the plan; None: the last one that was verified"
    )
    verdict: Verdict | None
    error: str = ""
    usage: Usage = Usage()


class MissionReported(Payload):
    """Step 10: the brief report (WF-09)."""

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
    """An operator has taken manual control of an asset: the console sends it no more commands.

    Only a stop's hold is still sent. The event stays in effect after a restart of the console.
    """

    binding: ClassVar[bool] = True
    kind: Literal["manual_control_taken"] = "manual_control_taken"
    asset: Name
    by: str


class ManualControlEnded(Payload):
    """An operator has ended manual control of an asset; nothing is resumed by it."""

    binding: ClassVar[bool] = True
    kind: Literal["manual_control_ended"] = "manual_control_ended"
    asset: Name
    by: str


class MissionAwaitsAssets(Payload):
    """A mission ended without its result because `assets` are under manual control.

    Once manual control of all of them has ended, its words are queued as the mission `again`, which
    is planned, checked and approved as a new one.
    """

    kind: Literal["mission_awaits_assets"] = "mission_awaits_assets"
    assets: tuple[Name, ...]
    again: str = Field(default="", description="the mission that takes its place, '' while waiting")


class StopUnconfirmed(Payload):
    """The assets not known to hold after a stop, each with the reason; if empty, all hold."""

    kind: Literal["stop_unconfirmed"] = "stop_unconfirmed"
    assets: dict[Name, str]


class StopReleased(Payload):
    """The operator released the stop: missions and alarms are processed again."""

    binding: ClassVar[bool] = True
    kind: Literal["stop_released"] = "stop_released"
    by: str
