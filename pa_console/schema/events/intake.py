"""Events of steps 1 and 2, of standing orders, and of questions about the log."""

from datetime import datetime
from typing import ClassVar, Literal

from pydantic import Field

from pa_console.schema.base import Name, NonNegative, Payload, StrictModel
from pa_console.schema.mission import Alarm, Mission, QueueEntry, StandingOrder, StandingStart


class AlarmRaised(Payload):
    """A situation in the picture needs a response; the alarm replaces one with the same id."""

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
    """Step 1: the waiting missions in order, with the reasons for it (WF-04, WF-05)."""

    kind: Literal["queue_changed"] = "queue_changed"
    entries: tuple[QueueEntry, ...]


class MissionPreempted(Payload):
    """The active mission went back to the queue because an emergency has priority."""

    kind: Literal["mission_preempted"] = "mission_preempted"
    by: str
    reason: str


class WorkflowMoved(Payload):
    """The mission's position in a workflow that a rule prescribes (WF-01).

    `phase` counts from 0; when the workflow is over, it is the number of phases, and `outcome` is
    set.
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
    """The mission left the queue and is in progress, under the same rule set until its end."""

    kind: Literal["mission_started"] = "mission_started"
    rules_content_sha256: str = Field(default="", description="content hash of that rule set")
    rules_warnings: tuple[str, ...] = Field(
        default=(), description="warnings about it: accepted by the operator, no critical check"
    )


class Reference(StrictModel):
    """Words of an order that refer to something, and their meaning in the present picture."""

    said: str
    means: str


class QuestionAsked(Payload):
    """Step 2: a question about an order's meaning; an `answer` decision is added to the order."""

    kind: Literal["question_asked"] = "question_asked"
    question: str
    said: str = Field(default="", description="the unclear words; '' for all of them")
    choices: tuple[str, ...] = Field(default=(), description="possible meanings, not exclusive")


class OrderRead(Payload):
    """Step 2: the reading of an order that refers to the picture or to earlier orders."""

    kind: Literal["order_read"] = "order_read"
    text: str = Field(description="the planned text: names in place of references")
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
    step: int = Field(ge=1, description="its number, counted from 1")
    steps: int = Field(ge=1, description="the number of steps in the order")
    text: str = Field(description="its words, with names in place of references")


QuestionTopic = Literal[
    "plan",  # why this plan, or why none
    "asset",  # why this asset
    "other_asset",  # why not that one
    "gate",  # why a gate has no guard
    "alternatives",  # which other plans would serve the order
]
"""The subject of a question."""


class AnswerLine(StrictModel):
    """One statement of an answer: its subject `about`, in a word or two, and its text `said`."""

    about: str
    said: str


class QuestionAnswered(Payload):
    """A question about the log, with its answer; no model was asked.

    The event's mission is the subject of the question. It causes no decision and no movement.
    """

    kind: Literal["question_answered"] = "question_answered"
    question: str = Field(description="the words of the operator")
    topic: QuestionTopic = "plan"
    subjects: tuple[Name, ...] = Field(default=(), description="the assets or the gate asked about")
    lines: tuple[AnswerLine, ...] = ()


class AgentMuted(Payload):
    """An operator has muted an agent, or unmuted it; a muted agent may only read and stop."""

    binding: ClassVar[bool] = True
    kind: Literal["agent_muted"] = "agent_muted"
    agent: str
    muted: bool
    by: str


class StandingOrderRead(Payload):
    """Step 2: the reading of a standing order, which has not been approved yet."""

    kind: Literal["standing_order_read"] = "standing_order_read"
    order: StandingOrder
    now: tuple[StandingStart, ...] = Field(default=(), description="its missions at once")
    moments: tuple[datetime, ...] = Field(
        default=(), exclude_if=lambda moments: not moments, description="its next moments"
    )
    first_s: NonNegative | None = Field(
        default=None,
        exclude_if=lambda first_s: first_s is None,
        description="the fleet's time at the first of its moments",
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
    """The order's condition became true for `subject`, or its moment came: a mission was queued."""

    kind: Literal["standing_order_started"] = "standing_order_started"
    order_id: str
    subject: Name | Literal[""] = ""
    late_s: NonNegative = Field(
        default=0.0, exclude_if=lambda late_s: not late_s, description="seconds after its moment"
    )


class StandingOrderWithheld(Payload):
    """The reason why a standing order started nothing although its condition or moment came.

    `subject` is the thing that met the condition.
    """

    kind: Literal["standing_order_withheld"] = "standing_order_withheld"
    order_id: str
    subject: str = ""
    reason: str


class StandingOrderScheduled(Payload):
    """The next moment of a timed order; `by` is the person who paused, resumed or skipped it."""

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
