"""The bodies of the HTTP interface: views of a session, and requests of clients."""

import hashlib
import json
from datetime import datetime
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from pa_console.fleets.authorization import Role, UnsignedApproval
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding, Verdict
from pa_console.schema.mission import (
    MAX_MISSION_TEXT,
    Alarm,
    DecisionKind,
    Metrics,
    MissionSource,
    MissionStatus,
    QueueEntry,
    StandingOrder,
    Verification,
)
from pa_console.schema.plan import MAX_ACTIONS, Action, Plan
from pa_console.schema.rule import Rule, RulesSeal
from pa_console.schema.telemetry import Picture
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState, StandingTrace

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class RequestBody(BaseModel):
    """A body that a client sends: what it does not know is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class MissionBody(RequestBody):
    """A mission in plain language."""

    text: Annotated[str, Field(min_length=1, max_length=MAX_MISSION_TEXT)]


class QuestionBody(RequestBody):
    """A question about the record."""

    text: Annotated[
        str,
        Field(
            min_length=1,
            max_length=MAX_MISSION_TEXT,
            description="Why?  Why not ASSET?  What would you do instead?",
        ),
    ]


class ActionBody(RequestBody):
    """One command of a plan of the operator's own."""

    agent: Annotated[str, Field(max_length=64)]
    command: Annotated[str, Field(max_length=160)]


class DecisionBody(RequestBody):
    """A decision on the waiting plan, named by its `request_id` and its hash.

    `shown_sha256` is that of the plan as `/v1/plans` gave it: the approval is for the plan that was
    shown.
    """

    kind: DecisionKind
    request_id: Annotated[str, Field(min_length=1, max_length=128)]
    shown_sha256: Sha256
    reason: Annotated[str, Field(max_length=600)] = ""
    override_judge: bool = False
    acknowledged: Annotated[
        tuple[str, ...], Field(max_length=256, description="ids of broken rules that are accepted")
    ] = ()
    actions: Annotated[
        tuple[ActionBody, ...] | None,
        Field(max_length=MAX_ACTIONS, description="another plan, for modify"),
    ] = None
    asked: Annotated[
        str,
        Field(
            max_length=MAX_MISSION_TEXT,
            description="the offered reading, for choose; the words, for answer",
        ),
    ] = ""


class SignatureBody(RequestBody):
    """A second person's signature under the waiting plan."""

    person: Annotated[str, Field(min_length=1, max_length=64, description="whose signature it is")]
    signed: Annotated[
        str,
        Field(
            min_length=1,
            max_length=32_768,
            description="`to_sign`, a full stop, and its signature in base64url without padding",
        ),
    ]


class ToSignView(BaseModel):
    """The text that a second person signs to approve the plan that waits."""

    person: str
    station: Annotated[str, Field(description="whose session it is")]
    request_id: str
    shown_sha256: Annotated[Sha256, Field(description="that of the plan in /v1/plans")]
    orders: Annotated[
        tuple[str, ...], Field(description="what is approved: the plan and its way to safety")
    ]
    acts: Annotated[
        tuple[str, ...],
        Field(description="what is approved besides: to override the judge, to accept a finding"),
    ]
    ends: Annotated[float, Field(description="when it expires, in seconds since 1970")]
    to_sign: Annotated[
        str, Field(description="the very bytes (ASCII) that are signed with Ed25519")
    ]
    sha256: Annotated[Sha256, Field(description="that of `to_sign`")]


class DecisionView(BaseModel):
    """The result of a decision."""

    accepted: bool
    detail: str
    by: str


class WhoView(BaseModel):
    """Whose token it is."""

    person: str
    role: Role


class AlarmView(BaseModel):
    """An alarm that is open."""

    model_config = ConfigDict(from_attributes=True)

    alarm: Alarm
    acknowledged_by: str


class StandingView(BaseModel):
    """A standing order in force; a timed one has its next moment, and is perhaps paused."""

    order: StandingOrder
    by: str
    started: int
    next: datetime | None
    paused: bool


class StateView(BaseModel):
    """The session as it stands after the event with the number `event`."""

    session: str
    event: int
    world: str
    rules: str
    rules_sha256: str
    model: str
    worker: str
    tick: int
    stopped: bool
    log_problem: str
    active: str | None
    waits_for_decision: bool
    queue: tuple[QueueEntry, ...]
    alarms: tuple[AlarmView, ...]
    standing: tuple[StandingView, ...]
    picture: Picture | None
    ended: str


class MissionView(BaseModel):
    """A mission in short."""

    id: str
    text: str
    source: MissionSource
    stage: str
    status: MissionStatus | None
    reason: str


class AttemptView(BaseModel):
    """One plan that was made for a mission, and the findings on it."""

    model_config = ConfigDict(from_attributes=True)

    number: int
    author: str
    plan: Plan | None
    error: str
    confidence: float | None
    unmet: tuple[str, ...]
    gaps: tuple[str, ...]
    findings: tuple[Finding, ...]
    verdict: Verdict | None
    judge_error: str


class MissionDetail(MissionView):
    """A mission with every plan that was made for it."""

    question: str
    choices: tuple[str, ...]
    attempts: tuple[AttemptView, ...]
    decisions: tuple[ev.DecisionMade, ...]
    verification: Verification | None
    report: str
    metrics: Metrics | None


class PlanView(BaseModel):
    """A plan that waits for a decision: all that an operator is shown before deciding."""

    mission: MissionView
    request: ev.ApprovalRequested
    shown_sha256: Sha256
    attempt: AttemptView | None
    question: str
    choices: tuple[str, ...]


class RulesView(BaseModel):
    """The rules in force."""

    name: str
    sha256: str
    seal: RulesSeal
    rules: tuple[Rule, ...]


def shown_sha256(request: ev.ApprovalRequested) -> str:
    """Return the SHA-256 of all that is put to the decision: plan, way to safety, objections."""
    told = request.model_dump(mode="json")
    text = json.dumps(told, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def state_view(state: SessionState, number: int) -> StateView:
    """Return the session as a client sees it."""
    started, current = state.started, state.current
    return StateView(
        session=started.session if started else "",
        event=number,
        world=started.world if started else "",
        rules=started.rules if started else "",
        rules_sha256=started.rules_sha256 if started else "",
        model=started.model if started else "",
        worker=state.worker.state if state.worker else "",
        tick=state.tick,
        stopped=state.stop is not None,
        log_problem=state.log_problem,
        active=state.active,
        waits_for_decision=current is not None and current.approval is not None,
        queue=state.queue,
        alarms=tuple(AlarmView.model_validate(item) for item in state.alarms),
        standing=tuple(_standing(trace) for trace in state.standing.values() if trace.in_force),
        picture=state.picture,
        ended=state.ended,
    )


def _standing(trace: StandingTrace) -> StandingView:
    return StandingView(
        order=trace.order,
        by=trace.by,
        started=trace.started,
        next=trace.next.moment if trace.next is not None else None,
        paused=trace.paused,
    )


def mission_view(trace: MissionTrace) -> MissionView:
    """Return a mission in short."""
    return MissionView(**_short(trace))


def mission_detail(trace: MissionTrace) -> MissionDetail:
    """Return a mission with all that is known of it."""
    return MissionDetail(
        **_short(trace),
        question=_question(trace),
        choices=trace.choices,
        attempts=tuple(AttemptView.model_validate(attempt) for attempt in trace.attempts),
        decisions=tuple(trace.decisions),
        verification=trace.verification,
        report=trace.report,
        metrics=trace.metrics,
    )


def plan_view(trace: MissionTrace, request: ev.ApprovalRequested) -> PlanView:
    """Return the plan of a mission that waits for a decision."""
    attempt = trace.find(request.attempt)
    return PlanView(
        mission=mission_view(trace),
        request=request,
        shown_sha256=shown_sha256(request),
        attempt=AttemptView.model_validate(attempt) if attempt is not None else None,
        question=_question(trace),
        choices=trace.choices,
    )


def to_sign_view(
    station: str, request: ev.ApprovalRequested, unsigned: UnsignedApproval
) -> ToSignView:
    """Return what a person is to sign of a request of the station called `station`."""
    approval = unsigned.approval
    return ToSignView(
        person=approval.person,
        station=station,
        request_id=request.request_id,
        shown_sha256=shown_sha256(request),
        orders=approval.orders,
        acts=approval.acts,
        ends=unsigned.ends,
        to_sign=unsigned.text,
        sha256=unsigned.sha256,
    )


def plan_of(actions: tuple[ActionBody, ...], reason: str) -> Plan:
    """Return the operator's own plan; raises ValidationError for what is no command."""
    parts = tuple(Action(agent=one.agent, command=one.command) for one in actions)
    return Plan(reason=reason or "changed by the operator", actions=parts)


def _question(trace: MissionTrace) -> str:
    waits = trace.approval is not None and trace.approval.state == "not_understood"
    return trace.questions[-1].question if waits and trace.questions else ""


def _short(trace: MissionTrace) -> dict[str, Any]:
    return {
        "id": trace.mission.id,
        "text": trace.mission.said,
        "source": trace.mission.source,
        "stage": trace.stage,
        "status": trace.status,
        "reason": trace.reason,
    }
