"""Events of step 1, of standing orders, and of questions about the record."""

from datetime import datetime
from typing import ClassVar, Literal

from pydantic import Field

from pa_console.schema.base import Name, NonNegative, Payload, StrictModel
from pa_console.schema.mission import Alarm, Mission, QueueEntry, StandingOrder, StandingStart


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
    """The mission's position in a workflow that a rule prescribes (WF-01).

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
    """The mission left the queue and is being worked on, under one rule set to its end."""

    kind: Literal["mission_started"] = "mission_started"
    rules_content_sha256: str = Field(default="", description="content hash of that rule set")
    rules_warnings: tuple[str, ...] = Field(
        default=(), description="what must be said of it: accepted although, nothing critical"
    )


class Reference(StrictModel):
    """Words of an order that point at something, and what they mean here and now."""

    said: str
    means: str


class QuestionAsked(Payload):
    """Step 1: one answer settles what is meant; an `answer` decides, and joins the order."""

    kind: Literal["question_asked"] = "question_asked"
    question: str
    said: str = Field(default="", description="the words that are not clear; '' for all of them")
    choices: tuple[str, ...] = Field(default=(), description="what may be meant; any else too")


class OrderRead(Payload):
    """Step 1: how an order is read that points at the picture or at what was ordered before."""

    kind: Literal["order_read"] = "order_read"
    text: str = Field(description="the order with names for what it points at; this is planned")
    typed: str = Field(description="what was typed, answers to questions included")
    references: tuple[Reference, ...] = ()
    follows: str = Field(
        default="",
        exclude_if=lambda words: not words,
        description="the commands of the order before, where the words lean on it",
    )


class OrderStepRead(Payload):
    """Step 1: one step of an order in steps; the plans that follow are for it alone."""

    kind: Literal["order_step_read"] = "order_step_read"
    step: int = Field(ge=1, description="its number, counted from 1")
    steps: int = Field(ge=1, description="how many the order has")
    text: str = Field(description="its words, with names for what they point at")


QuestionTopic = Literal[
    "plan",  # why this plan, or why none
    "asset",  # why this asset
    "other_asset",  # why not that one
    "gate",  # why a gate has no guard
    "alternatives",  # what else would serve the order
]
"""The subject of a question."""


class AnswerLine(StrictModel):
    """One statement of an answer: what it is `about`, in a word or two, and what is `said`."""

    about: str
    said: str


class QuestionAnswered(Payload):
    """A question about the record, with its answer; no model was asked.

    The event's mission is the subject of the question. No decision follows, and no asset moves by
    it.
    """

    kind: Literal["question_answered"] = "question_answered"
    question: str = Field(description="the words of the operator")
    topic: QuestionTopic = "plan"
    subjects: tuple[Name, ...] = Field(default=(), description="the assets or the gate asked about")
    lines: tuple[AnswerLine, ...] = ()


class AgentMuted(Payload):
    """An operator has muted an agent, or let it propose again; muted, it may only read and stop."""

    binding: ClassVar[bool] = True
    kind: Literal["agent_muted"] = "agent_muted"
    agent: str
    muted: bool
    by: str


class StandingOrderRead(Payload):
    """Step 1: how an order is read that is to hold from now on; nobody has approved it yet."""

    kind: Literal["standing_order_read"] = "standing_order_read"
    order: StandingOrder
    now: tuple[StandingStart, ...] = Field(default=(), description="what it would start at once")
    moments: tuple[datetime, ...] = Field(
        default=(), exclude_if=lambda moments: not moments, description="the next of its moments"
    )
    first_s: NonNegative | None = Field(
        default=None,
        exclude_if=lambda first_s: first_s is None,
        description="the fleet's time at the first of its moments",
    )
    allowed: tuple[str, ...] = Field(
        default=(), description="the commands that may be given unasked by it, as the rules say"
    )


class StandingOrderApproved(Payload):
    """An operator has approved the standing order; it is in force until it is revoked."""

    binding: ClassVar[bool] = True
    kind: Literal["standing_order_approved"] = "standing_order_approved"
    order: StandingOrder
    by: str


class StandingOrderStarted(Payload):
    """Its condition became true of `subject`, or its moment came, and a mission was queued."""

    kind: Literal["standing_order_started"] = "standing_order_started"
    order_id: str
    subject: Name | Literal[""] = ""
    late_s: NonNegative = Field(
        default=0.0, exclude_if=lambda late_s: not late_s, description="seconds after its moment"
    )


class StandingOrderWithheld(Payload):
    """Its condition became true of `subject`, or its moment came, and nothing was started."""

    kind: Literal["standing_order_withheld"] = "standing_order_withheld"
    order_id: str
    subject: str = ""
    reason: str


class StandingOrderScheduled(Payload):
    """The next moment of a timed order; `by` is whoever paused or resumed an order, or skipped."""

    kind: Literal["standing_order_scheduled"] = "standing_order_scheduled"
    order_id: str
    moment: datetime | None = None
    at_s: NonNegative | None = Field(default=None, description="the fleet's time at that moment")
    paused: bool = False
    by: str = ""
    change: Literal["", "paused", "resumed", "skipped"] = ""


class StandingOrderRevoked(Payload):
    """The standing order is in force no more."""

    binding: ClassVar[bool] = True
    kind: Literal["standing_order_revoked"] = "standing_order_revoked"
    order_id: str
    by: str
    reason: str = ""
