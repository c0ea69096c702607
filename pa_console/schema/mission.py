"""Missions from intake to outcome, and the alarms and standing orders that start them."""

from collections.abc import Iterator
from datetime import datetime, timedelta
from typing import Literal, Self

from pydantic import Field, model_validator

from pa_console.schema.base import AlarmPriority, Name, NonNegative, StrictModel
from pa_console.schema.plan import Plan

MAX_MISSION_TEXT = 2000
STANDING = "standing instruction"
"""The name of the decider of a plan that was approved beforehand, without a look at it."""

ELSEWHERE = "at another station"
"""The suffix of the name of a person who has signed at another station."""

DecisionKind = Literal["approve", "reject", "modify", "choose", "answer"]
ApprovalState = Literal[
    "approve",  # understood, and all of it is planned
    "narrowed",  # understood; the plan leaves out a part of the order, and says why
    "warned",  # a Medium rule is broken, which the operator has to accept
    "may_be_misunderstood",  # its words and its reading differ, or the models were not sure
    "not_understood",  # no order, or none that can be read: asked back, and nothing is proposed
    "judge_objects",  # the judge said Failure: overriding it needs a reason
    "blocked",  # nobody may approve it
]
"""The state of a plan for the operator who decides on it: the worst that holds."""
MissionStatus = Literal[
    "verified", "unverified", "refused", "rejected", "held", "cancelled", "failed"
]
Outcome = Literal["pass", "fail", "unknown"]
MissionSource = Literal["operator", "alarm", "standing", "agent"]
"""The source of a mission: a person, an alarm, a standing order, or a program that proposes it."""


class Mission(StrictModel):
    """One mission command in plain language (paper, Step 1)."""

    id: str
    text: str = Field(min_length=1, max_length=MAX_MISSION_TEXT)
    typed: str = Field(default="", description="what was typed, where words of it were misspelt")
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
        description="the agent's own plan, where it proposed one",
    )
    offered: bool = Field(
        default=False,
        exclude_if=lambda offered: not offered,
        description="the world's own standing order, which nobody typed: all others go first",
    )
    follows: str = Field(
        default="",
        exclude_if=lambda words: not words,
        description="the commands of the order before, where the words lean on it",
    )
    subject: Name | None = Field(default=None, description="track, asset or gate it is about")
    gate: Name | None = Field(default=None, description="the gate concerned, if one is")

    @property
    def said(self) -> str:
        """The mission as its operator typed it; `text` is how it is read."""
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
    """The decision of the operator, or of an instruction given at the start, and its reason."""

    kind: DecisionKind
    request_id: str = Field(
        default="", description="the request it answers; refused when another one waits"
    )
    by: str = "operator"
    reason: str = ""
    override_judge: bool = False
    acknowledged: tuple[str, ...] = Field(default=(), description="rule ids of warnings accepted")
    plan: Plan | None = Field(default=None, description="the operator's own plan, for `modify`")
    asked: str = Field(
        default="",
        description="the offered reading that was meant, for `choose`; the words, for `answer`",
    )
    signatures: dict[str, str] = Field(
        default={},
        exclude_if=lambda signatures: not signatures,
        description="the signed approval of everybody who approved, by name, where there are keys",
    )
    standing_order: str = Field(
        default="",
        exclude_if=lambda name: not name,
        description="id of the standing order by which it was given, and nobody was asked",
    )

    @property
    def standing(self) -> bool:
        """True if it was given beforehand."""
        return self.by.startswith(STANDING)

    @property
    def settles(self) -> bool:
        """True if it ends the wait: neither another plan nor another reading is proposed."""
        return self.kind in ("approve", "reject")


class ActionOutcome(StrictModel):
    """The evidence of telemetry on one action: it happened or not."""

    agent: Name
    command: str
    outcome: Outcome
    reason: str


class Verification(StrictModel):
    """Telemetry's answer on whether the plan happened and every gate stayed covered.

    It holds for `as_of_s`: every value that a pass rests on was sent at that time or later.
    """

    outcome: Outcome
    actions: tuple[ActionOutcome, ...]
    gates_lost: tuple[Name, ...] = ()
    gates_unknown: tuple[Name, ...] = ()
    reason: str = ""
    as_of_s: NonNegative = 0.0


class Metrics(StrictModel):
    """Seconds per stage of one mission; execution is in simulated seconds, the rest wall time.

    End to end is from the command to the mission's end. The judge's verdicts on the outcome are no
    part of that: they come when nobody needs the model.
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
        description="looking for what else an unclear order may mean, after the verdict",
    )
    decision_s: NonNegative = 0.0
    dispatch_s: NonNegative = 0.0
    execution_s: NonNegative = 0.0
    outcome_s: NonNegative = 0.0
    end_to_end_s: NonNegative = 0.0
    attempts: int = 0
    plans: int = Field(default=0, description="plans executed; more than one in a workflow")
    halts: int = Field(default=0, description="plans halted because a premise broke")


AlarmKind = Literal[
    "hostile_track", "defiant_track", "unknown_track", "unauthorized_track",
    "coverage_lost", "coverage_unknown", "asset_failed", "link_lost", "low_battery",
    "camera_lost", "suspect_telemetry", "many_contacts", "way_blocked",
]  # fmt: skip


class Alarm(StrictModel):
    """One thing that needs a response; it stays open until its cause is gone.

    `command` is the mission that answers it, in plain language; empty when an operator's eye is
    the whole response.
    """

    id: str
    kind: AlarmKind
    priority: AlarmPriority
    subject: Name = Field(description="the track, asset, gate, camera or sensor it is about")
    gate: Name | None = None
    text: str
    command: str = ""
    raised_s: NonNegative
    distance_m: NonNegative | None = Field(default=None, description="of a track to its gate")


class QueueEntry(StrictModel):
    """One mission that waits, and why it stands where it stands (WF-04, WF-05)."""

    mission: Mission
    priority: AlarmPriority
    distance_m: NonNegative | None = None
    deferred: bool = False
    reason: str


SubjectKind = Literal["asset", "track", "gate"]
"""The subjects that a standing order watches, one by one."""

MOST_STARTS = 6
"""The number of missions that a standing order starts in an hour, unless it gives its own."""

SUBJECT, PLACE = "{it}", "{place}"
"""The placeholders in an order for its subject, and for that subject's gate."""


DAY_S = 86400.0
"""Seconds of a day."""


class Schedule(StrictModel):
    """Moments of the station's clock: one, or a first one and those at an interval after it.

    Whole days are days of the station's calendar, so an hour stays the same in summer and winter.
    """

    start: datetime = Field(description="the first moment")
    at_once: bool = Field(default=False, description="the first moment is that of the approval")
    every_s: NonNegative = Field(default=0.0, description="the interval, 0 for one moment")
    until: datetime | None = Field(default=None, description="no moment is after it")
    times: int = Field(default=0, ge=0, description="the number of moments, 0 for no limit")
    stay_s: NonNegative = Field(
        default=0.0, description="whoever went goes back after so long in place, 0 for not"
    )
    leave: datetime | None = Field(default=None, description="when whoever went goes back")

    to_base: bool = Field(
        default=False, description="whoever went goes to the base then, not to the place before"
    )

    @property
    def once(self) -> bool:
        """True if it has only one moment and no stay."""
        return not self.every_s and not self.stays

    @property
    def stays(self) -> bool:
        """True if the assets that it sends come back."""
        return self.stay_s > 0.0 or self.leave is not None

    def moment(self, number: int) -> datetime | None:
        """Return the moment of that number from 0, None if there is no such moment."""
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
    """A movement that no plan may contain: of these assets, to these places.

    Without assets it is for every asset, without places for every movement.
    """

    assets: tuple[Name, ...] = ()
    places: tuple[Name, ...] = ()

    def forbids(self, agent: str, goal: str | None) -> bool:
        """Return whether `agent` may not be sent to `goal`; None is where it stands."""
        if goal is None or (self.assets and agent not in self.assets):
            return False
        return not self.places or goal in self.places


class StandingOrder(StrictModel):
    """A trigger, and the order that it starts a mission with; or a ban, which starts none.

    The trigger is a `condition` on the picture or a `schedule` of the station's clock. Each mission
    is planned, checked and approved like any other; one whose order is `unasked` may be approved by
    the standing order itself, as far as the rules allow.
    """

    id: str = Field(pattern=r"^S[0-9]+$")
    text: str = Field(min_length=1, max_length=MAX_MISSION_TEXT, description="as it was given")
    each: SubjectKind | None = Field(
        default=None, exclude_if=lambda each: each is None, description="None with a schedule"
    )
    condition: str = Field(
        default="",
        exclude_if=lambda condition: not condition,
        description="CEL over `it`, `id`, `now` and `world`; empty with a schedule",
    )
    schedule: Schedule | None = Field(default=None, exclude_if=lambda schedule: schedule is None)
    ban: Ban | None = Field(default=None, exclude_if=lambda ban: ban is None)
    words: str = Field(min_length=1, description="the trigger in plain words")
    order: str = Field(min_length=1, description="with {it} and {place} for the subject")
    unasked: bool = Field(default=False, description="it says that nobody need be asked")
    most_an_hour: int = Field(default=MOST_STARTS, ge=1, le=60)

    @model_validator(mode="after")
    def _one_trigger(self) -> Self:
        of_state = bool(self.condition) and self.each is not None
        triggers = of_state + (self.schedule is not None) + (self.ban is not None)
        if triggers != 1 or bool(self.condition) != of_state:
            raise ValueError(
                "a standing order has one of a condition of something, a schedule and a ban"
            )
        return self

    @property
    def once(self) -> bool:
        """True if it starts one mission and is over then."""
        return self.schedule is not None and self.schedule.once

    def order_for(self, subject: str, place: str) -> str:
        """Return the order for one subject, and the gate at which that is; '' for nowhere."""
        return self.order.replace(SUBJECT, subject).replace(PLACE, place)

    @property
    def order_in_words(self) -> str:
        """The order as people read it."""
        if self.each is None:
            return self.order
        what = {"asset": "that asset", "track": "that track", "gate": "that gate"}[self.each]
        return self.order.replace(SUBJECT, what).replace(PLACE, "its gate")


class StandingStart(StrictModel):
    """The mission that a standing order starts for one subject, '' for a moment of the clock."""

    subject: Name | Literal[""] = ""
    order: str
