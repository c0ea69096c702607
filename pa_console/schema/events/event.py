"""All events, one small class per kind; log, screen and replay use only these."""

from datetime import datetime
from typing import Annotated

from pydantic import Field

from pa_console.schema.base import Payload, Role, ServerUse, StrictModel
from pa_console.schema.events.execution import (
    AllStopped,
    CommandRefused,
    CommandReplied,
    CommandResent,
    CommandSent,
    ManualControlEnded,
    ManualControlTaken,
    MissionAwaitsAssets,
    MissionFinished,
    MissionReported,
    MissionVerified,
    OutcomeJudged,
    PlanHalted,
    StepsHeld,
    StepsPaused,
    StopReleased,
    StopUnconfirmed,
)
from pa_console.schema.events.intake import (
    AgentMuted,
    AlarmAcknowledged,
    AlarmCleared,
    AlarmRaised,
    AnswerLine,
    MissionPreempted,
    MissionReceived,
    MissionStarted,
    OrderRead,
    OrderStepRead,
    QuestionAnswered,
    QuestionAsked,
    QuestionTopic,
    QueueChanged,
    Reference,
    StandingOrderApproved,
    StandingOrderRead,
    StandingOrderRevoked,
    StandingOrderScheduled,
    StandingOrderStarted,
    StandingOrderWithheld,
    WorkflowMoved,
)
from pa_console.schema.events.planning import (
    MOST_READINGS,
    ApprovalRequested,
    DecisionMade,
    OrderReadAgain,
    PictureDigested,
    PlanChecked,
    PlanJudged,
    PlanProposed,
    PlanRehearsed,
    PlanVoided,
    PromptBuilt,
    RepairRequested,
    RulesRetrieved,
    TextStreamed,
)
from pa_console.schema.events.session import (
    MOST_CONTACTS,
    UNVERIFIED,
    AuthorityChanged,
    CameraStill,
    CommandTaken,
    ContactLost,
    ContactReported,
    ContactsLeftOut,
    IncidentHappened,
    IncidentSource,
    Level,
    LogSigned,
    LogTroubled,
    Noticed,
    OutsideReport,
    ReportedContact,
    RulesReplaced,
    ServerChanged,
    ServerState,
    SessionEnded,
    SessionResumed,
    SessionStarted,
    TakChanged,
    TakState,
    TelemetryReceived,
    WorkerChanged,
    WorkerState,
)

# `EventPayload` collects the payloads; these are the other names that are used with them.
__all__ = (
    "MOST_CONTACTS", "MOST_READINGS", "UNVERIFIED", "AnswerLine", "Event", "EventPayload",
    "IncidentSource", "Level", "OutsideReport", "Payload", "QuestionTopic", "Reference",
    "ReportedContact", "Role", "ServerState", "ServerUse", "TakState", "WorkerState",
)  # fmt: skip

EventPayload = Annotated[
    SessionStarted | TelemetryReceived | IncidentHappened | Noticed | WorkerChanged
    | ServerChanged
    | AlarmRaised | AlarmAcknowledged | AlarmCleared | QueueChanged | MissionPreempted
    | WorkflowMoved | CommandResent | PlanHalted | MissionReceived | MissionStarted
    | QuestionAsked | OrderRead | RulesRetrieved | PictureDigested | PromptBuilt
    | TextStreamed | PlanProposed | PlanRehearsed | PlanChecked | PlanJudged | OrderReadAgain
    | RepairRequested | ApprovalRequested | DecisionMade | PlanVoided | CommandSent | CommandReplied
    | MissionVerified | OutcomeJudged | MissionReported | MissionFinished | AllStopped
    | StopReleased | StopUnconfirmed | CommandRefused | RulesReplaced | SessionEnded
    | SessionResumed | CommandTaken | AuthorityChanged | LogSigned | LogTroubled
    | StandingOrderRead | StandingOrderApproved
    | StandingOrderStarted | StandingOrderWithheld | StandingOrderRevoked
    | StandingOrderScheduled | QuestionAnswered | OrderStepRead | StepsHeld
    | StepsPaused
    | TakChanged | ContactReported | ContactLost | ContactsLeftOut | AgentMuted
    | ManualControlTaken | ManualControlEnded | MissionAwaitsAssets
    | CameraStill,
    Field(discriminator="kind"),
]  # fmt: skip


class Event(StrictModel):
    """A payload with its time (UTC and simulation tick) and its mission."""

    t: datetime
    tick: int
    mission: str | None = None
    data: EventPayload
