"""Everything that happens, one small class per kind; log, screen and replay see only these."""

from datetime import datetime
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from pa_console.schema.alarm import Alarm, QueueEntry
from pa_console.schema.base import StrictModel
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.finding import Finding, Usage, Verdict
from pa_console.schema.incident import Incident
from pa_console.schema.mission import Decision, Metrics, Mission, MissionStatus, Verification
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import Digest, Picture

Role = Literal["planner", "judge"]
Level = Literal["info", "warning", "alarm"]
IncidentSource = Literal["operator", "scenario"]
WorkerState = Literal["loading", "ready", "dead", "unavailable"]


class Payload(StrictModel):
    """Base of all event payloads; a transient one is shown live and never logged."""

    transient: ClassVar[bool] = False


class SessionStarted(Payload):
    """Pins everything needed to run the session again."""

    kind: Literal["session_started"] = "session_started"
    session: str
    version: str
    world: str
    world_sha256: str
    rules: str
    rules_sha256: str
    model: str
    model_sha256: str
    seed: int
    scenario: str = ""
    scenario_sha256: str = ""
    sampler: str
    grammar_sha256: str
    readonly: bool = False
    packages: dict[str, str] = {}


class TelemetryReceived(Payload):
    """A new common operational picture."""

    kind: Literal["telemetry"] = "telemetry"
    picture: Picture


class IncidentHappened(Payload):
    """Something was injected into the simulation: set-up, scenario or what-if."""

    kind: Literal["incident"] = "incident"
    incident: Incident
    source: IncidentSource = "operator"


class Noticed(Payload):
    """A change worth an operator's eye: a gate lost or covered, a track seen, an asset down."""

    kind: Literal["noticed"] = "noticed"
    level: Level
    subject: str
    text: str


class WorkerChanged(Payload):
    """The LLM worker started loading, became ready, died or was restarted."""

    kind: Literal["worker"] = "worker"
    state: WorkerState
    detail: str = ""


class AlarmRaised(Payload):
    """The picture shows something that needs a response; the alarm replaces one of the same id."""

    kind: Literal["alarm_raised"] = "alarm_raised"
    alarm: Alarm


class AlarmAcknowledged(Payload):
    """The operator has seen the alarm; it stays open until its cause is gone."""

    kind: Literal["alarm_acknowledged"] = "alarm_acknowledged"
    alarm_id: str
    by: str = "operator"


class AlarmCleared(Payload):
    """The cause of the alarm is gone."""

    kind: Literal["alarm_cleared"] = "alarm_cleared"
    alarm_id: str
    reason: str


class QueueChanged(Payload):
    """Step 1: the missions that wait, next first, and why in this order (WF-04, WF-05)."""

    kind: Literal["queue_changed"] = "queue_changed"
    entries: tuple[QueueEntry, ...]


class MissionPreempted(Payload):
    """The active mission went back to the queue because an emergency goes first."""

    kind: Literal["mission_preempted"] = "mission_preempted"
    by: str
    reason: str


class WorkflowMoved(Payload):
    """Where the mission stands in a workflow that a rule prescribes (WF-01).

    `phase` counts from 0; it is the number of phases when the workflow is over, with `outcome`.
    """

    kind: Literal["workflow_moved"] = "workflow_moved"
    workflow: str
    rule_id: str
    track: str
    phases: tuple[str, ...]
    phase: int
    skipped: tuple[str, ...] = ()
    command: str = ""
    outcome: str = ""


class MissionReceived(Payload):
    """Step 1: a mission was accepted and queued; `position` 0 means next."""

    kind: Literal["mission_received"] = "mission_received"
    mission: Mission
    position: int


class MissionStarted(Payload):
    """The mission left the queue and is being worked on."""

    kind: Literal["mission_started"] = "mission_started"


class RulesRetrieved(Payload):
    """Step 2: pinned and top-k rules with their scores, best first."""

    kind: Literal["rules_retrieved"] = "rules_retrieved"
    method: str
    hits: tuple[RuleHit, ...]
    seconds: float


class PictureDigested(Payload):
    """Step 3: the picture as the models are given it."""

    kind: Literal["picture_digested"] = "picture_digested"
    digest: Digest
    seconds: float


class PromptBuilt(Payload):
    """Step 4: the whole prompt of one role."""

    kind: Literal["prompt_built"] = "prompt_built"
    role: Role
    attempt: int
    system: str
    user: str
    seconds: float


class TextStreamed(Payload):
    """A piece of the model's answer, as it arrives."""

    transient: ClassVar[bool] = True
    kind: Literal["text_streamed"] = "text_streamed"
    role: Role
    attempt: int
    text: str


class PlanProposed(Payload):
    """Step 5: the model's whole answer; `plan` is None when it could not be read."""

    kind: Literal["plan_proposed"] = "plan_proposed"
    attempt: int
    author: Literal["planner", "operator"] = "planner"
    text: str
    plan: Plan | None
    error: str = ""
    usage: Usage = Usage()


class PlanRehearsed(Payload):
    """Step 6: the plan was run in a forked simulation."""

    kind: Literal["plan_rehearsed"] = "plan_rehearsed"
    attempt: int
    rehearsal: Rehearsal
    seconds: float


class PlanChecked(Payload):
    """Step 6: one finding for every rule in force."""

    kind: Literal["plan_checked"] = "plan_checked"
    attempt: int
    findings: tuple[Finding, ...]
    seconds: float


class PlanJudged(Payload):
    """Step 6: the JudgeLLM's verdict; None with an error means hold."""

    kind: Literal["plan_judged"] = "plan_judged"
    attempt: int
    verdict: Verdict | None
    error: str = ""
    usage: Usage = Usage()


class RepairRequested(Payload):
    """Step 6: the findings go back to the planner for another attempt."""

    kind: Literal["repair_requested"] = "repair_requested"
    attempt: int
    reasons: tuple[str, ...]


class ApprovalRequested(Payload):
    """Step 6: the operator's turn; the lists say what stands in the way and what is needed."""

    kind: Literal["approval_requested"] = "approval_requested"
    request_id: str = Field(default="", description="a decision may name it, see Decision")
    attempt: int
    plan: Plan
    blocked_by: tuple[str, ...] = Field(default=(), description="reasons nobody may override")
    acknowledge: tuple[str, ...] = Field(default=(), description="rule ids of warnings")
    needs_override: bool = Field(default=False, description="the judge said Failure")


class DecisionMade(Payload):
    """The operator's decision; `accepted` is False when it was not admissible, with the reason."""

    kind: Literal["decision_made"] = "decision_made"
    attempt: int
    decision: Decision
    accepted: bool
    detail: str = ""


class PlanVoided(Payload):
    """The world moved under an approved plan; it goes through the safeguards again."""

    kind: Literal["plan_voided"] = "plan_voided"
    attempt: int
    reason: str


class CommandSent(Payload):
    """Step 7: a command went out on the link."""

    kind: Literal["command_sent"] = "command_sent"
    command: DeviceCommand


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


class CommandReplied(Payload):
    """Step 7: a device answered, or was given up on (`failed`, timed out)."""

    kind: Literal["command_replied"] = "command_replied"
    reply: CommandReply


class MissionVerified(Payload):
    """Step 7: what telemetry says of the executed plan."""

    kind: Literal["mission_verified"] = "mission_verified"
    verification: Verification
    seconds: float


class OutcomeJudged(Payload):
    """Step 7: the JudgeLLM's verdict on the outcome."""

    kind: Literal["outcome_judged"] = "outcome_judged"
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
    """The operator's stop: every asset was told to hold, open plans are void."""

    kind: Literal["all_stopped"] = "all_stopped"
    by: str


class SessionEnded(Payload):
    """The last line of a session that ended in order."""

    kind: Literal["session_ended"] = "session_ended"
    reason: str


EventPayload = Annotated[
    SessionStarted | TelemetryReceived | IncidentHappened | Noticed | WorkerChanged
    | AlarmRaised | AlarmAcknowledged | AlarmCleared | QueueChanged | MissionPreempted
    | WorkflowMoved | CommandResent | PlanHalted | MissionReceived | MissionStarted
    | RulesRetrieved | PictureDigested | PromptBuilt
    | TextStreamed | PlanProposed | PlanRehearsed | PlanChecked | PlanJudged | RepairRequested
    | ApprovalRequested | DecisionMade | PlanVoided | CommandSent | CommandReplied
    | MissionVerified | OutcomeJudged | MissionReported | MissionFinished | AllStopped
    | SessionEnded,
    Field(discriminator="kind"),
]  # fmt: skip


class Event(StrictModel):
    """A payload with when it happened (UTC and simulation tick) and the mission it belongs to."""

    t: datetime
    tick: int
    mission: str | None = None
    data: EventPayload
