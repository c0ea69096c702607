"""Everything that happens, one small class per kind; log, screen and replay see only these."""

from datetime import datetime
from typing import Annotated

from pydantic import Field

from pa_console.schema.base import StrictModel
from pa_console.schema.events.base import Payload, Role
from pa_console.schema.events.execution import (
    AllStopped,
    CommandRefused,
    CommandReplied,
    CommandResent,
    CommandSent,
    MissionFinished,
    MissionReported,
    MissionVerified,
    OutcomeJudged,
    PlanHalted,
    StopReleased,
    StopUnconfirmed,
)
from pa_console.schema.events.intake import (
    AlarmAcknowledged,
    AlarmCleared,
    AlarmRaised,
    MissionPreempted,
    MissionReceived,
    MissionStarted,
    OrderRead,
    QuestionAsked,
    QueueChanged,
    Reference,
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
from pa_console.schema.events.questions import AnswerLine, QuestionAnswered, QuestionTopic
from pa_console.schema.events.session import (
    AuthorityChanged,
    CommandTaken,
    IncidentHappened,
    IncidentSource,
    Level,
    LogSigned,
    LogTroubled,
    Noticed,
    RulesReplaced,
    ServerChanged,
    ServerState,
    ServerUse,
    SessionEnded,
    SessionResumed,
    SessionStarted,
    TelemetryReceived,
    WorkerChanged,
    WorkerState,
)
from pa_console.schema.events.standing import (
    StandingOrderApproved,
    StandingOrderRead,
    StandingOrderRevoked,
    StandingOrderStarted,
    StandingOrderWithheld,
)
from pa_console.schema.events.tak import (
    MOST_CONTACTS,
    UNVERIFIED,
    ContactLost,
    ContactReported,
    ContactsLeftOut,
    OutsideReport,
    ReportedContact,
    TakChanged,
    TakState,
)

__all__ = (
    "MOST_CONTACTS",
    "MOST_READINGS",
    "UNVERIFIED",
    "AlarmAcknowledged",
    "AlarmCleared",
    "AlarmRaised",
    "AllStopped",
    "AnswerLine",
    "ApprovalRequested",
    "AuthorityChanged",
    "CommandRefused",
    "CommandReplied",
    "CommandResent",
    "CommandSent",
    "CommandTaken",
    "ContactLost",
    "ContactReported",
    "ContactsLeftOut",
    "DecisionMade",
    "Event",
    "EventPayload",
    "IncidentHappened",
    "IncidentSource",
    "Level",
    "LogSigned",
    "LogTroubled",
    "MissionFinished",
    "MissionPreempted",
    "MissionReceived",
    "MissionReported",
    "MissionStarted",
    "MissionVerified",
    "Noticed",
    "OrderRead",
    "OrderReadAgain",
    "OutcomeJudged",
    "OutsideReport",
    "Payload",
    "PictureDigested",
    "PlanChecked",
    "PlanHalted",
    "PlanJudged",
    "PlanProposed",
    "PlanRehearsed",
    "PlanVoided",
    "PromptBuilt",
    "QuestionAnswered",
    "QuestionAsked",
    "QuestionTopic",
    "QueueChanged",
    "Reference",
    "RepairRequested",
    "ReportedContact",
    "Role",
    "RulesReplaced",
    "RulesRetrieved",
    "ServerChanged",
    "ServerState",
    "ServerUse",
    "SessionEnded",
    "SessionResumed",
    "SessionStarted",
    "StandingOrderApproved",
    "StandingOrderRead",
    "StandingOrderRevoked",
    "StandingOrderStarted",
    "StandingOrderWithheld",
    "StopReleased",
    "StopUnconfirmed",
    "TakChanged",
    "TakState",
    "TelemetryReceived",
    "TextStreamed",
    "WorkerChanged",
    "WorkerState",
    "WorkflowMoved",
)

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
    | StandingOrderStarted | StandingOrderWithheld | StandingOrderRevoked | QuestionAnswered
    | TakChanged | ContactReported | ContactLost | ContactsLeftOut,
    Field(discriminator="kind"),
]  # fmt: skip


class Event(StrictModel):
    """A payload with when it happened (UTC and simulation tick) and the mission it belongs to."""

    t: datetime
    tick: int
    mission: str | None = None
    data: EventPayload
