"""Folds the event stream into the state that every view shows; live and replay use the same."""

from collections import deque
from dataclasses import dataclass, field
from datetime import datetime

from pa_console.schema import event as ev
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.finding import Finding, Usage, Verdict
from pa_console.schema.mission import Decision, Metrics, Mission, MissionStatus, Verification
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import Digest, Picture
from pa_console.session.wording import in_words

NOTICES_KEPT = 500


@dataclass
class Attempt:
    """One pass through steps 5 and 6: what was asked, answered, found, rehearsed and judged."""

    number: int
    author: str = "planner"
    system: str = ""
    user: str = ""
    text: str = ""
    plan: Plan | None = None
    error: str = ""
    usage: Usage = field(default_factory=Usage)
    findings: tuple[Finding, ...] = ()
    checks_s: float = 0.0
    rehearsal: Rehearsal | None = None
    rehearsal_s: float = 0.0
    judge_text: str = ""
    verdict: Verdict | None = None
    judged: bool = False
    judge_error: str = ""
    judge_usage: Usage = field(default_factory=Usage)
    repair: tuple[str, ...] = ()


@dataclass
class CommandTrace:
    """A dispatched command and every reply to it, oldest first."""

    command: DeviceCommand
    replies: list[CommandReply] = field(default_factory=list[CommandReply])


@dataclass
class MissionTrace:
    """Everything known of one mission; `stage` is the step it is in, in the paper's order."""

    mission: Mission
    stage: str = "queued"
    method: str = ""
    hits: tuple[RuleHit, ...] = ()
    retrieval_s: float = 0.0
    digest: Digest | None = None
    attempts: list[Attempt] = field(default_factory=list[Attempt])
    approval: ev.ApprovalRequested | None = None
    decisions: list[ev.DecisionMade] = field(default_factory=list[ev.DecisionMade])
    voided: str = ""
    commands: dict[str, CommandTrace] = field(default_factory=dict[str, CommandTrace])
    verification: Verification | None = None
    outcome_verdict: Verdict | None = None
    outcome_error: str = ""
    report: str = ""
    status: MissionStatus | None = None
    reason: str = ""
    metrics: Metrics | None = None

    def attempt(self, number: int) -> Attempt:
        """Return attempt `number` (from 1), opening it when it is new."""
        for attempt in reversed(self.attempts):
            if attempt.number == number:
                return attempt
        self.attempts.append(Attempt(number))
        return self.attempts[-1]

    @property
    def decision(self) -> Decision | None:
        """The last decision that was accepted."""
        return next((d.decision for d in reversed(self.decisions) if d.accepted), None)


@dataclass(frozen=True)
class Notice:
    """One line of the event list."""

    t: datetime
    tick: int
    level: ev.Level
    subject: str
    text: str


@dataclass
class SessionState:
    """The whole session as it stands after the last applied event."""

    started: ev.SessionStarted | None = None
    ended: str = ""
    tick: int = 0
    picture: Picture | None = None
    worker: ev.WorkerChanged | None = None
    missions: dict[str, MissionTrace] = field(default_factory=dict[str, MissionTrace])
    active: str | None = None
    notices: deque[Notice] = field(default_factory=lambda: deque(maxlen=NOTICES_KEPT))

    @property
    def current(self) -> MissionTrace | None:
        """The mission being worked on, else the latest one."""
        if self.active is not None:
            return self.missions[self.active]
        return next(reversed(self.missions.values()), None)

    def apply(self, event: ev.Event) -> None:
        """Take one event in; an event of an unknown mission changes no mission."""
        self.tick = max(self.tick, event.tick)
        self._apply_to_session(event)
        trace = self.missions.get(event.mission) if event.mission else None
        if trace is not None:
            _apply_planning(trace, event.data)
            _apply_execution(trace, event.data)

    def _apply_to_session(self, event: ev.Event) -> None:
        match event.data:
            case ev.SessionStarted():
                self.started = event.data
            case ev.TelemetryReceived(picture=picture):
                self.picture = picture
            case ev.WorkerChanged(state=state, detail=detail):
                self.worker = event.data
                level = "info" if state in ("loading", "ready") else "warning"
                self._notice(event, level, "model", f"{state} {detail}".strip())
            case ev.Noticed(level=level, subject=subject, text=text):
                self._notice(event, level, subject, text)
            case ev.IncidentHappened(incident=incident):
                self._notice(event, "warning", "incident", in_words(incident))
            case ev.MissionReceived(mission=mission):
                self.missions[mission.id] = MissionTrace(mission)
                self._notice(event, "info", mission.id, mission.text)
            case ev.MissionStarted():
                self.active = event.mission if event.mission in self.missions else None
            case ev.MissionFinished(status=status, reason=reason):
                self.active = None
                level = "info" if status == "verified" else "warning"
                self._notice(event, level, event.mission or "", f"{status}: {reason}")
            case ev.AllStopped(by=by):
                self._notice(event, "alarm", "stop", f"all assets hold, ordered by {by}")
            case ev.SessionEnded(reason=reason):
                self.ended = reason
            case _:
                pass

    def _notice(self, event: ev.Event, level: ev.Level, subject: str, text: str) -> None:
        self.notices.append(Notice(event.t, event.tick, level, subject, text))


def _apply_planning(trace: MissionTrace, data: ev.EventPayload) -> None:
    """Steps 2 to 6."""
    match data:
        case ev.MissionStarted():
            trace.stage = "retrieve"
        case ev.RulesRetrieved(method=method, hits=hits, seconds=seconds):
            trace.stage, trace.method, trace.hits = "picture", method, hits
            trace.retrieval_s = seconds
        case ev.PictureDigested(digest=digest):
            trace.stage, trace.digest = "prompt", digest
        case ev.PromptBuilt(role="planner", attempt=number, system=system, user=user):
            trace.stage = "plan"
            attempt = trace.attempt(number)
            attempt.system, attempt.user = system, user
        case ev.PromptBuilt(role="judge"):
            trace.stage = "judge"
        case ev.TextStreamed(role=role, attempt=number, text=text):
            attempt = trace.attempt(number)
            if role == "planner":
                attempt.text += text
            else:
                attempt.judge_text += text
        case ev.PlanProposed(attempt=number):
            trace.stage = "safeguards"
            attempt = trace.attempt(number)
            attempt.author, attempt.text, attempt.plan = data.author, data.text, data.plan
            attempt.error, attempt.usage = data.error, data.usage
        case ev.PlanRehearsed(attempt=number, rehearsal=rehearsal, seconds=seconds):
            attempt = trace.attempt(number)
            attempt.rehearsal, attempt.rehearsal_s = rehearsal, seconds
        case ev.PlanChecked(attempt=number, findings=findings, seconds=seconds):
            attempt = trace.attempt(number)
            attempt.findings, attempt.checks_s = findings, seconds
        case ev.PlanJudged(attempt=number):
            attempt = trace.attempt(number)
            attempt.verdict, attempt.judge_error = data.verdict, data.error
            attempt.judge_usage, attempt.judged = data.usage, True
        case ev.RepairRequested(attempt=number, reasons=reasons):
            trace.attempt(number).repair = reasons
        case _:
            pass


def _apply_execution(trace: MissionTrace, data: ev.EventPayload) -> None:
    """The operator's decision and steps 7 and 8."""
    match data:
        case ev.ApprovalRequested():
            trace.stage, trace.approval = "decide", data
        case ev.DecisionMade(accepted=accepted):
            trace.decisions.append(data)
            if accepted:
                trace.approval = None
        case ev.PlanVoided(reason=reason):
            trace.voided, trace.approval = reason, None
        case ev.CommandSent(command=command):
            trace.stage = "execute"
            trace.commands[command.command_id] = CommandTrace(command)
        case ev.CommandReplied(reply=reply) if reply.command_id in trace.commands:
            trace.commands[reply.command_id].replies.append(reply)
        case ev.MissionVerified(verification=verification):
            trace.stage, trace.verification = "verify", verification
        case ev.OutcomeJudged(verdict=verdict, error=error):
            trace.outcome_verdict, trace.outcome_error = verdict, error
        case ev.MissionReported(text=text):
            trace.stage, trace.report = "report", text
        case ev.MissionFinished(status=status, reason=reason, metrics=metrics):
            trace.stage, trace.approval = "finished", None
            trace.status, trace.reason, trace.metrics = status, reason, metrics
        case _:
            pass
