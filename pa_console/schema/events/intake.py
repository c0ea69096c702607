"""Events of steps 1 and 2, of alarms, of standing orders, and of questions about the log."""

from datetime import datetime
from typing import ClassVar, Literal

from pydantic import Field

from pa_console.schema.base import Name, NonNegative, Payload, StrictModel
from pa_console.schema.mission import Alarm, Mission, QueueEntry, StandingOrder, StandingStart


class AlarmRaised(Payload):
    """A situation needs a response; the alarm replaces an earlier alarm with the same id."""

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
    """Step 1: the waiting missions in order, each with the reason for its place (WF-04, WF-05)."""

    kind: Literal["queue_changed"] = "queue_changed"
    entries: tuple[QueueEntry, ...]


class MissionPreempted(Payload):
    """The active mission went back to the queue, because an emergency has priority."""

    kind: Literal["mission_preempted"] = "mission_preempted"
    by: str
    reason: str


class WorkflowMoved(Payload):
    """The mission's position in a workflow that a rule prescribes (WF-01).

    `phase` counts from 0. When the workflow is over, `phase` is the number of phases, and `outcome`
    is set.
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
    """Step 1: a mission was accepted and queued; at `position` 0, it is the next."""

    kind: Literal["mission_received"] = "mission_received"
    mission: Mission
    position: int


class MissionStarted(Payload):
    """The mission left the queue and is in progress; it keeps its rule set until its end."""

    kind: Literal["mission_started"] = "mission_started"
    rules_content_sha256: str = Field(default="", description="content hash of the rule set")
    rules_warnings: tuple[str, ...] = Field(default=(), description="warnings about the rule set")


class Reference(StrictModel):
    """Words of an order that refer to something, and their meaning in the present picture."""

    said: str
    means: str


class QuestionAsked(Payload):
    """Step 2: a question about an order's meaning, which a decision of kind `answer` answers."""

    kind: Literal["question_asked"] = "question_asked"
    question: str
    said: str = Field(default="", description="the unclear words; '' for the whole order")
    choices: tuple[str, ...] = Field(default=(), description="some possible meanings")


class OrderRead(Payload):
    """Step 2: the reading of an order that refers to the picture or to earlier orders."""

    kind: Literal["order_read"] = "order_read"
    text: str = Field(description="the text that is planned, with names in place of references")
    typed: str = Field(description="the typed text, including answers to questions")
    references: tuple[Reference, ...] = ()
    follows: str = Field(
        default="",
        exclude_if=lambda words: not words,
        description="the previous order's commands, if the words refer to it",
    )


class OrderStepRead(Payload):
    """Step 2: one step of an order in steps; the next plans are for this step alone."""

    kind: Literal["order_step_read"] = "order_step_read"
    step: int = Field(ge=1, description="the number of the step, from 1")
    steps: int = Field(ge=1, description="the number of steps in the order")
    text: str = Field(description="the words of the step, with names in place of references")


QuestionTopic = Literal[
    "plan",  # why this plan was made, or why no plan was
    "asset",  # why this asset was chosen
    "other_asset",  # why another asset was not chosen
    "gate",  # why a gate has no guard
    "alternatives",  # which other plans would serve the order
]
"""The subject of a question."""


class AnswerLine(StrictModel):
    """One statement of an answer: the text `said`, and in a word or two what it is `about`."""

    about: str
    said: str


class QuestionAnswered(Payload):
    """A question about the log, with its answer; no model was asked.

    The event belongs to the mission that the question is about. It causes no decision and no
    movement.
    """

    kind: Literal["question_answered"] = "question_answered"
    question: str = Field(description="the words of the operator")
    topic: QuestionTopic = "plan"
    subjects: tuple[Name, ...] = Field(
        default=(), description="the assets or the gate that the question is about"
    )
    lines: tuple[AnswerLine, ...] = ()


class AgentMuted(Payload):
    """An operator has muted or unmuted an agent; a muted agent may only read and stop."""

    binding: ClassVar[bool] = True
    kind: Literal["agent_muted"] = "agent_muted"
    agent: str
    muted: bool
    by: str


class StandingOrderRead(Payload):
    """Step 2: the reading of a standing order, which has not been approved yet."""

    kind: Literal["standing_order_read"] = "standing_order_read"
    order: StandingOrder
    now: tuple[StandingStart, ...] = Field(
        default=(), description="the missions that it would start at once"
    )
    moments: tuple[datetime, ...] = Field(
        default=(), exclude_if=lambda moments: not moments, description="its next moments"
    )
    first_s: NonNegative | None = Field(
        default=None,
        exclude_if=lambda first_s: first_s is None,
        description="the fleet's time at the first moment",
    )
    allowed: tuple[str, ...] = Field(
        default=(), description="commands that the rules let it give without approval"
    )


class StandingOrderApproved(Payload):
    """An operator has approved the standing order; it is in force until it is revoked."""

    binding: ClassVar[bool] = True
    kind: Literal["standing_order_approved"] = "standing_order_approved"
    order: StandingOrder
    by: str


class StandingOrderStarted(Payload):
    """A standing order queued a mission because its condition was met or its moment came.

    `subject` is the asset, track or gate that met the condition; '' for a moment.
    """

    kind: Literal["standing_order_started"] = "standing_order_started"
    order_id: str
    subject: Name | Literal[""] = ""
    late_s: NonNegative = Field(
        default=0.0,
        exclude_if=lambda late_s: not late_s,
        description="delay after the moment, in seconds",
    )


class StandingOrderWithheld(Payload):
    """A standing order started no mission although its condition was met or its moment came.

    `subject` is the asset, track or gate that met the condition; '' for a moment.
    """

    kind: Literal["standing_order_withheld"] = "standing_order_withheld"
    order_id: str
    subject: str = ""
    reason: str


class StandingOrderScheduled(Payload):
    """The next moment of a timed order.

    If a person has paused or resumed the order, or skipped a moment, `by` names the person.
    """

    kind: Literal["standing_order_scheduled"] = "standing_order_scheduled"
    order_id: str
    moment: datetime | None = None
    at_s: NonNegative | None = Field(default=None, description="the fleet's time at that moment")
    paused: bool = False
    by: str = ""
    change: Literal["", "paused", "resumed", "skipped"] = ""


class StandingOrderRevoked(Payload):
    """The standing order is no longer in force."""

    binding: ClassVar[bool] = True
    kind: Literal["standing_order_revoked"] = "standing_order_revoked"
    order_id: str
    by: str
    reason: str = ""
