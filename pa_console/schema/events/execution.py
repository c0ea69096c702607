"""Events of steps 7 and 8: commands, halts, verification, report, stop."""

from typing import ClassVar, Literal

from pydantic import Field

from pa_console.schema.base import Name, Payload
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.finding import Usage, Verdict
from pa_console.schema.mission import Metrics, MissionStatus, Verification


class CommandSent(Payload):
    """Step 7: a command went out on the link."""

    binding: ClassVar[bool] = True

    kind: Literal["command_sent"] = "command_sent"
    command: DeviceCommand


class CommandRefused(Payload):
    """Step 7: a command was kept back at the last gate, for nobody decided it or all is stopped."""

    binding: ClassVar[bool] = True
    kind: Literal["command_refused"] = "command_refused"
    command: DeviceCommand
    reason: str


class CommandResent(Payload):
    """Step 7: a command that was not answered went out again under the same id."""

    kind: Literal["command_resent"] = "command_resent"
    command_id: str
    times: int


class PlanHalted(Payload):
    """Step 7: a premise of the running plan broke; assets were brought to a safe state."""

    kind: Literal["plan_halted"] = "plan_halted"
    attempt: int
    reasons: tuple[str, ...]
    safe_state: tuple[str, ...] = Field(default=(), description="what each asset was told")


class StepsHeld(Payload):
    """Step 7: actions of an approved plan that are not sent, because of what came before them."""

    kind: Literal["steps_held"] = "steps_held"
    attempt: int
    orders: tuple[str, ...] = Field(description="what is not sent: agent and command")
    reason: str


class StepsPaused(Payload):
    """Step 7: a mission sends no further step until somebody lets it go on, or goes on."""

    kind: Literal["steps_paused"] = "steps_paused"
    paused: bool
    by: str


class CommandReplied(Payload):
    """Step 7: a device answered, or was given up on (`failed`, timed out)."""

    kind: Literal["command_replied"] = "command_replied"
    reply: CommandReply


class MissionVerified(Payload):
    """Step 7: what telemetry says of the executed plan."""

    kind: Literal["mission_verified"] = "mission_verified"
    verification: Verification
    seconds: float
    step: int = Field(
        default=0,
        exclude_if=lambda step: not step,
        description="the step of the plan, counted from 1; 0 for a plan of one step",
    )


class OutcomeJudged(Payload):
    """Step 7: the JudgeLLM's verdict on the outcome of an executed plan, or why there is none.

    Nothing waits for it: it may come after other plans of the mission, and after its end.
    """

    kind: Literal["outcome_judged"] = "outcome_judged"
    attempt: int | None = Field(
        default=None, description="the plan; the last one that was verified, where it is not told"
    )
    verdict: Verdict | None
    error: str = ""
    usage: Usage = Usage()


class MissionReported(Payload):
    """Step 8: the brief report (WF-09)."""

    kind: Literal["mission_reported"] = "mission_reported"
    text: str


class MissionFinished(Payload):
    """The mission is over."""

    kind: Literal["mission_finished"] = "mission_finished"
    status: MissionStatus
    reason: str
    metrics: Metrics


class AllStopped(Payload):
    """The operator's stop: every asset is told to hold, open plans are void.

    From here to a `StopReleased` no command but hold and report leaves the station.
    """

    binding: ClassVar[bool] = True

    kind: Literal["all_stopped"] = "all_stopped"
    by: str


class ManualControlTaken(Payload):
    """An operator has taken manual control of an asset: the console sends it nothing more.

    A stop's hold alone is still sent. The event carries over a restart of the console.
    """

    binding: ClassVar[bool] = True
    kind: Literal["manual_control_taken"] = "manual_control_taken"
    asset: Name
    by: str


class ManualControlEnded(Payload):
    """An operator has given an asset back; nothing goes on by that."""

    binding: ClassVar[bool] = True
    kind: Literal["manual_control_ended"] = "manual_control_ended"
    asset: Name
    by: str


class MissionAwaitsAssets(Payload):
    """A mission ended without its result because `assets` are under manual control.

    Once all of them are back, its words are queued as the mission `again`, which is planned,
    checked and approved anew.
    """

    kind: Literal["mission_awaits_assets"] = "mission_awaits_assets"
    assets: tuple[Name, ...]
    again: str = Field(default="", description="the mission that takes its place, '' while waiting")


class StopUnconfirmed(Payload):
    """The assets not known to stand after a stop, each with the reason; none: all stand."""

    kind: Literal["stop_unconfirmed"] = "stop_unconfirmed"
    assets: dict[Name, str]


class StopReleased(Payload):
    """The operator released the stop: missions are taken, and alarms answered, again."""

    binding: ClassVar[bool] = True
    kind: Literal["stop_released"] = "stop_released"
    by: str
