"""A session for other programs: its state, missions and plans as plain data."""

import hashlib
import json
from collections.abc import Iterator
from datetime import datetime
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding, Verdict
from pa_console.schema.mission import (
    Alarm,
    Metrics,
    MissionSource,
    MissionStatus,
    QueueEntry,
    StandingOrder,
    Verification,
)
from pa_console.schema.plan import Plan
from pa_console.schema.rule import Rule, RulesSeal
from pa_console.schema.telemetry import Picture
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.session.state_parts import StandingTrace
from pa_console.views.event_words import in_steps, step_lines

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class AlarmView(BaseModel):
    """An open alarm."""

    model_config = ConfigDict(from_attributes=True)

    alarm: Alarm
    acknowledged_by: str


class StandingView(BaseModel):
    """A standing order in force; a timed order also has its next moment, and may be paused."""

    order: StandingOrder
    by: str
    started: int
    next: datetime | None
    paused: bool


class ManualView(BaseModel):
    """An asset under manual control, and who took it; '' if only the asset reports it."""

    asset: str
    by: str


class StateView(BaseModel):
    """The state of the session after event number `event`.

    `awaiting` maps missions to the assets under manual control that they wait for.
    """

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
    manual: tuple[ManualView, ...]
    awaiting: dict[str, tuple[str, ...]]
    picture: Picture | None
    ended: str


class MissionView(BaseModel):
    """A mission in brief."""

    id: str
    text: str
    source: MissionSource
    stage: str
    status: MissionStatus | None
    reason: str


class AttemptView(BaseModel):
    """One plan for a mission, and the findings on it."""

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
    """A mission with all of its plans."""

    question: str
    choices: tuple[str, ...]
    attempts: tuple[AttemptView, ...]
    decisions: tuple[ev.DecisionMade, ...]
    stills: dict[int, ev.CameraStill]
    """The camera image that was last shown with each plan, by the plan's number."""
    verification: Verification | None
    report: str
    metrics: Metrics | None


class PlanView(BaseModel):
    """A plan that waits for a decision, with everything that the operator sees."""

    mission: MissionView
    request: ev.ApprovalRequested
    shown_sha256: Sha256
    attempt: AttemptView | None
    still: ev.CameraStill | None
    """The camera image that is shown with the plan; GET /v1/stills/SHA256 returns the file."""
    steps: tuple[str, ...]
    """The lines of a plan with steps, each with its condition; empty for other plans."""
    question: str
    choices: tuple[str, ...]


class RulesView(BaseModel):
    """The rules in force."""

    name: str
    sha256: str
    seal: RulesSeal
    rules: tuple[Rule, ...]


def shown_sha256(request: ev.ApprovalRequested) -> str:
    """Return the SHA-256 of everything shown for a decision: plan, way to safety, objections."""
    shown = request.model_dump(mode="json")
    text = json.dumps(shown, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def state_view(state: SessionState, number: int) -> StateView:
    """Return the state of the session for a client."""
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
        manual=tuple(_manual(state)),
        awaiting=dict(state.awaiting),
        picture=state.picture,
        ended=state.ended,
    )


def _manual(state: SessionState) -> Iterator[ManualView]:
    """Yield the assets under manual control: those taken here, then those that report it."""
    yield from (ManualView(asset=name, by=trace.by) for name, trace in state.manual.items())
    for name, asset in state.picture.assets.items() if state.picture is not None else ():
        if asset.manual and name not in state.manual:
            yield ManualView(asset=name, by="")


def _standing(trace: StandingTrace) -> StandingView:
    return StandingView(
        order=trace.order,
        by=trace.by,
        started=trace.started,
        next=trace.next.moment if trace.next is not None else None,
        paused=trace.paused,
    )


def mission_view(trace: MissionTrace) -> MissionView:
    """Return a mission in brief."""
    return MissionView(**_short(trace))


def mission_detail(trace: MissionTrace) -> MissionDetail:
    """Return a mission with all its details."""
    return MissionDetail(
        **_short(trace),
        question=_question(trace),
        choices=trace.choices,
        attempts=tuple(AttemptView.model_validate(attempt) for attempt in trace.attempts),
        decisions=tuple(trace.decisions),
        stills=dict(trace.stills),
        verification=trace.verification,
        report=trace.report,
        metrics=trace.metrics,
    )


def plan_view(trace: MissionTrace, request: ev.ApprovalRequested) -> PlanView:
    """Return the plan of a mission that waits for a decision."""
    attempt = trace.find(request.attempt)
    lines = step_lines(request.plan) if in_steps(request.plan) else ()
    return PlanView(
        steps=tuple(line.in_words for line in lines),
        mission=mission_view(trace),
        request=request,
        shown_sha256=shown_sha256(request),
        attempt=AttemptView.model_validate(attempt) if attempt is not None else None,
        still=trace.still,
        question=_question(trace),
        choices=trace.choices,
    )


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
