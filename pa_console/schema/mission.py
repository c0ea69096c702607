"""Missions from intake to outcome, and the alarms and standing orders that start them."""

from collections.abc import Iterator
from datetime import datetime, timedelta
from typing import Literal, Self

from pydantic import Field, model_validator

from pa_console.schema.base import AlarmPriority, Name, NonNegative, StrictModel
from pa_console.schema.plan import Plan

MAX_MISSION_TEXT = 2000
STANDING = "standing instruction"
"""The beginning of `by` in a decision that was given in advance, before the plan was known."""

ELSEWHERE = "at another station"
"""The words after the name of a person who signed at another station."""

DecisionKind = Literal["approve", "reject", "modify", "choose", "answer"]
ApprovalState = Literal[
    "approve",  # the order was understood, and all of it is planned
    "narrowed",  # the order was understood; the plan leaves out a part of it, with the reason
    "warned",  # a rule of Medium priority is broken, which the operator must acknowledge
    "may_be_misunderstood",  # the order's words and its reading differ, or the models were unsure
    "not_understood",  # the text is no clear order: the console asks and proposes no plan
    "judge_objects",  # the judge's verdict is Failure: an override needs a reason
    "blocked",  # the plan cannot be approved
]
"""The state of a plan for the operator who decides on it; the most severe state applies."""
MissionStatus = Literal[
    "verified", "unverified", "refused", "rejected", "held", "cancelled", "failed"
]
Outcome = Literal["pass", "fail", "unknown"]
MissionSource = Literal["operator", "alarm", "standing", "agent"]
"""The source of a mission: an operator, an alarm, a standing order, or an agent over MCP."""

MOST_STARTS = 6
"""The default limit on the missions that a standing order starts per hour."""

SUBJECT, PLACE = "{it}", "{place}"
"""The placeholders in an order for its subject and for the subject's gate."""

DAY_S = 86400.0
"""The number of seconds in a day."""


class Mission(StrictModel):
    """One mission command in plain language (paper, Step 1)."""

    id: str
    text: str = Field(min_length=1, max_length=MAX_MISSION_TEXT)
    typed: str = Field(default="", description="the typed text, if it differs from `text`")
    source: MissionSource = "operator"
    created: datetime
    alarm: str = Field(default="", description="id of the alarm that it answers")
    standing: str = Field(
        default="",
        exclude_if=lambda name: not name,
        description="id of the standing order that started it",
    )
    agent: str = Field(
        default="",
        exclude_if=lambda name: not name,
        description="name of the agent that proposed it over MCP",
    )
    proposed: Plan | None = Field(
        default=None,
        exclude_if=lambda plan: plan is None,
        description="the agent's own plan, if it proposed one",
    )
    offered: bool = Field(
        default=False,
        exclude_if=lambda offered: not offered,
        description="true for the world's own standing order, before which all other missions go",
    )
    follows: str = Field(
        default="",
        exclude_if=lambda words: not words,
        description="the previous order's commands, if the words refer to it",
    )
    subject: Name | None = Field(
        default=None, description="the track, asset or gate that it is about"
    )
    gate: Name | None = Field(default=None, description="the gate that it concerns, if any")

    @property
    def said(self) -> str:
        """The mission's words as the operator typed them; `text` is the text that is planned."""
        return self.typed or self.text

    @property
    def origin(self) -> str:
        """The source of the mission in plain words; '' for the operator."""
        match self.source:
            case "alarm":
                return "by alarm"
            case "standing":
                return f"by standing order {self.standing}"
            case "agent":
                return f"proposed by agent {self.agent} over MCP"
            case "operator":
                return ""


class Decision(StrictModel):
    """The decision of the operator, or of a standing instruction, with its reason."""

    kind: DecisionKind
    request_id: str = Field(
        default="", description="the request that it answers; refused if another request waits"
    )
    by: str = "operator"
    reason: str = ""
    override_judge: bool = False
    acknowledged: tuple[str, ...] = Field(
        default=(), description="ids of the broken rules that are acknowledged"
    )
    plan: Plan | None = Field(default=None, description="the operator's own plan, for `modify`")
    asked: str = Field(
        default="",
        description="the chosen reading, for `choose`; the words, for `answer`",
    )
    signatures: dict[str, str] = Field(
        default={},
        exclude_if=lambda signatures: not signatures,
        description="the signed approvals by the person's name, if there are keys",
    )
    standing_order: str = Field(
        default="",
        exclude_if=lambda name: not name,
        description="id of the standing order that made the decision",
    )

    @property
    def standing(self) -> bool:
        """True if the decision was given in advance."""
        return self.by.startswith(STANDING)

    @property
    def settles(self) -> bool:
        """True if the decision ends the wait, by an approval or a rejection."""
        return self.kind in ("approve", "reject")


class ActionOutcome(StrictModel):
    """The outcome of one action according to telemetry, with the reason."""

    agent: Name
    command: str
    outcome: Outcome
    reason: str


class Verification(StrictModel):
    """The outcome of a plan according to telemetry: its actions, and the cover of every gate.

    It is valid as of `as_of_s`: every value on which a pass depends was sent then or later.
    """

    outcome: Outcome
    actions: tuple[ActionOutcome, ...]
    gates_lost: tuple[Name, ...] = ()
    gates_unknown: tuple[Name, ...] = ()
    reason: str = ""
    as_of_s: NonNegative = 0.0


class Metrics(StrictModel):
    """The seconds of each stage of one mission: simulated time for the execution, else wall time.

    The end-to-end time is from the command to the mission's end. It does not include the judge's
    verdicts on outcomes, which are requested while the model is idle.
    """

    retrieval_s: NonNegative = 0.0
    picture_s: NonNegative = 0.0
    prompt_s: NonNegative = 0.0
    first_token_s: NonNegative = 0.0
    planning_s: NonNegative = 0.0
    checks_s: NonNegative = 0.0
    rehearsal_s: NonNegative = 0.0
    judging_s: NonNegative = 0.0
    readings_s: NonNegative = Field(
        default=0.0,
        description="the search for other readings of an unclear order",
    )
    decision_s: NonNegative = 0.0
    dispatch_s: NonNegative = 0.0
    execution_s: NonNegative = 0.0
    outcome_s: NonNegative = 0.0
    end_to_end_s: NonNegative = 0.0
    attempts: int = 0
    plans: int = Field(
        default=0, description="number of executed plans, more than one in a workflow"
    )
    halts: int = Field(default=0, description="number of halted plans")


AlarmKind = Literal[
    "hostile_track", "defiant_track", "unknown_track", "unauthorized_track",
    "coverage_lost", "coverage_unknown", "asset_failed", "link_lost", "low_battery",
    "camera_lost", "suspect_telemetry", "many_contacts", "way_blocked",
]  # fmt: skip


class Alarm(StrictModel):
    """A situation that needs a response; the alarm stays open until its cause is gone.

    `command` is the mission that answers the alarm, in plain language; empty if the operator only
    has to see the alarm.
    """

    id: str
    kind: AlarmKind
    priority: AlarmPriority
    subject: Name = Field(description="the track, asset, gate, camera or sensor that it is about")
    gate: Name | None = None
    text: str
    command: str = ""
    raised_s: NonNegative
    distance_m: NonNegative | None = Field(
        default=None, description="distance of the track from its gate"
    )


class QueueEntry(StrictModel):
    """One waiting mission, and the reason for its position in the queue (WF-04, WF-05)."""

    mission: Mission
    priority: AlarmPriority
    distance_m: NonNegative | None = None
    deferred: bool = False
    reason: str


SubjectKind = Literal["asset", "track", "gate"]
"""The kinds of subjects that a standing order can watch, each subject by itself."""


class Schedule(StrictModel):
    """One moment of the station's clock, or a first moment and repetitions at an interval.

    An interval of whole days follows the calendar, so the hour is the same in summer and winter.
    """

    start: datetime = Field(description="the first moment")
    at_once: bool = Field(
        default=False, description="true if the first moment is that of the approval"
    )
    every_s: NonNegative = Field(default=0.0, description="the interval, or 0 for one moment")
    until: datetime | None = Field(
        default=None, description="the time after which there is no moment"
    )
    times: int = Field(default=0, ge=0, description="the number of moments, or 0 for no limit")
    stay_s: NonNegative = Field(
        default=0.0, description="seconds in place after which the assets go back, or 0 for never"
    )
    leave: datetime | None = Field(default=None, description="the time at which the assets go back")

    to_base: bool = Field(
        default=False,
        description="true if the assets go back to the base, not to their previous place",
    )

    @property
    def once(self) -> bool:
        """True if there is only one moment, and the assets do not go back afterwards."""
        return not self.every_s and not self.stays

    @property
    def stays(self) -> bool:
        """True if the assets go back to their places or to the base afterwards."""
        return self.stay_s > 0.0 or self.leave is not None

    def moment(self, number: int) -> datetime | None:
        """Return moment `number`, from 0; None if there is no such moment."""
        if number and (not self.every_s or (self.times and number >= self.times)):
            return None
        if self.every_s % DAY_S:
            at = self.start + timedelta(seconds=number * self.every_s)
        else:
            days = timedelta(seconds=number * self.every_s)
            at = (self.start.astimezone().replace(tzinfo=None) + days).astimezone()
        return None if self.until is not None and at > self.until else at

    def moments(self, most: int) -> Iterator[datetime]:
        """Yield the first `most` moments, or all if there are fewer."""
        for number in range(most):
            at = self.moment(number)
            if at is None:
                return
            yield at


class Ban(StrictModel):
    """Movements that no plan may contain: of these assets to these places.

    Without `assets`, the ban applies to every asset; without `places`, to every place.
    """

    assets: tuple[Name, ...] = ()
    places: tuple[Name, ...] = ()

    def forbids(self, agent: str, goal: str | None) -> bool:
        """Return whether `agent` may not be sent to `goal`; None means that it stays."""
        if goal is None or (self.assets and agent not in self.assets):
            return False
        return not self.places or goal in self.places


class StandingOrder(StrictModel):
    """A trigger with the order of the missions that it starts, or a ban, which starts none.

    The trigger is a `condition` on the picture or a `schedule` of the station's clock. Each mission
    is planned, checked and approved like any other. If the standing order is `unasked`, it may
    itself approve the plans of its missions as far as the rules allow.
    """

    id: str = Field(pattern=r"^S[0-9]+$")
    text: str = Field(
        min_length=1, max_length=MAX_MISSION_TEXT, description="the standing order as it was given"
    )
    each: SubjectKind | None = Field(
        default=None,
        exclude_if=lambda each: each is None,
        description="the kind of subject; None without a condition",
    )
    condition: str = Field(
        default="",
        exclude_if=lambda condition: not condition,
        description="CEL over `it`, `id`, `now` and `world`; empty without a condition",
    )
    schedule: Schedule | None = Field(default=None, exclude_if=lambda schedule: schedule is None)
    ban: Ban | None = Field(default=None, exclude_if=lambda ban: ban is None)
    words: str = Field(min_length=1, description="the trigger in plain words")
    order: str = Field(
        min_length=1, description="the order, with {it} for the subject and {place} for its gate"
    )
    unasked: bool = Field(default=False, description="true if it states that no approval is needed")
    most_an_hour: int = Field(default=MOST_STARTS, ge=1, le=60)

    @model_validator(mode="after")
    def _one_trigger(self) -> Self:
        of_state = bool(self.condition) and self.each is not None
        triggers = of_state + (self.schedule is not None) + (self.ban is not None)
        if triggers != 1 or bool(self.condition) != of_state:
            raise ValueError(
                "a standing order needs exactly one of condition (with each), schedule and ban"
            )
        return self

    @property
    def once(self) -> bool:
        """True if the standing order starts one mission and then ends."""
        return self.schedule is not None and self.schedule.once

    def order_for(self, subject: str, place: str) -> str:
        """Return the order for one subject at the gate `place`, which is '' without a gate."""
        return self.order.replace(SUBJECT, subject).replace(PLACE, place)

    @property
    def order_in_words(self) -> str:
        """The order in plain words, with its subject and place described."""
        if self.each is None:
            return self.order
        target = {"asset": "that asset", "track": "that track", "gate": "that gate"}[self.each]
        return self.order.replace(SUBJECT, target).replace(PLACE, "its gate")


class StandingStart(StrictModel):
    """A mission that a standing order starts; `subject` is '' for a moment of the clock."""

    subject: Name | Literal[""] = ""
    order: str
