"""OpenTelemetry spans made from a session's events: a trace for each mission, a span for each step.

A span has the times of its events, so it is as exact as the log even if it is made later. Only
`opentelemetry-api` is required here.
"""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal

from opentelemetry.context import Context
from opentelemetry.trace import Span, StatusCode, Tracer, set_span_in_context
from opentelemetry.util.types import AttributeValue

from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage

Step = Literal[
    "intake",
    "retrieve",
    "picture",
    "prompt",
    "plan",
    "rehearse",
    "safeguards",
    "judge",
    "read_again",
    "decide",
    "execute",
    "verify",
    "outcome",
    "report",
]
"""The names of spans; each span is a part of a step of a mission."""

NUMBERS: dict[Step, int] = {
    "intake": 1,
    "retrieve": 3,
    "picture": 3,
    "prompt": 4,
    "plan": 4,
    "rehearse": 5,
    "safeguards": 5,
    "judge": 6,
    "read_again": 6,
    "decide": 7,
    "execute": 8,
    "verify": 9,
    "outcome": 9,
    "report": 10,
}
"""The number of the mission's step for each span; the judge's prompt is in the judge's step."""

MISSION = "mission"
"""The name of the span of a whole mission."""
MISSIONS_KEPT = 64
"""The number of finished missions that are kept for later verdicts on their outcomes."""

Attributes = Mapping[str, AttributeValue]


@dataclass
class _MissionSpan:
    """The span of one mission, and those of its steps that have not ended."""

    root: Span
    context: Context
    ended: bool = False
    open: dict[Step, Span] = field(default_factory=dict[Step, Span])


class MissionSpans:
    """The spans of a session's missions, made by `tracer`; call `take` with every event, in order.

    Attributes are numbers and the names of rules, assets and frames. Unless `words` is True, the
    texts of operators and models and the names of people are left out.
    """

    def __init__(self, tracer: Tracer, *, words: bool = False) -> None:
        self._tracer, self._words = tracer, words
        self._session: dict[str, AttributeValue] = {}
        self._missions: OrderedDict[str, _MissionSpan] = OrderedDict()

    def take(self, event: ev.Event) -> None:
        """Process one event; an event of an unknown mission is ignored."""
        match event.data:
            case ev.SessionStarted():
                self._begin_session(event.data)
            case ev.MissionReceived() if event.mission is not None:
                self._receive(event.mission, event.data, event.t)
            case ev.AllStopped():
                for traced in self._missions.values():
                    self._note(traced, "all stopped", event.t)
            case ev.SessionEnded():
                for traced in self._missions.values():
                    self._end(traced, event.t, {"pa.mission.status": "unfinished"})
            case _:
                traced = self._missions.get(event.mission) if event.mission else None
                if traced is not None:
                    self._prepare(traced, event)
                    self._examine(traced, event)
                    self._decide(traced, event)
                    self._execute(traced, event)

    def _begin_session(self, started: ev.SessionStarted) -> None:
        self._session = {
            "pa.session.id": started.session,
            "pa.model": started.model,
            "pa.rules.sha256": started.rules_sha256,
            "pa.world.sha256": started.world_sha256,
        }

    def _receive(self, name: str, received: ev.MissionReceived, t: datetime) -> None:
        """Begin the trace of a mission that waits in the queue, with step 1."""
        mission = received.mission
        about: dict[str, AttributeValue] = {
            **self._session,
            "pa.mission.id": name,
            "pa.mission.source": mission.source,
        }
        if mission.agent:
            about["pa.mission.agent"] = mission.agent
        if self._words:
            about["pa.mission.text"] = mission.said
        root = self._tracer.start_span(
            MISSION, context=Context(), attributes=about, start_time=_ns(t)
        )
        traced = _MissionSpan(root, set_span_in_context(root, Context()))
        self._missions[name] = traced
        self._open(traced, "intake", t, {"pa.queue.position": received.position})
        while len(self._missions) > MISSIONS_KEPT and next(iter(self._missions.values())).ended:
            self._missions.popitem(last=False)

    def _prepare(self, traced: _MissionSpan, event: ev.Event) -> None:
        """Process an event of steps 1 to 4: queue, rules, picture, prompt and plan."""
        t = event.t
        match event.data:
            case ev.MissionStarted():
                self._close(traced, "intake", t)
            case ev.MissionPreempted():
                for step in tuple(traced.open):
                    self._close(traced, step, t, {"pa.preempted": True})
                self._open(traced, "intake", t)
            case ev.QuestionAsked(choices=choices):
                self._note(traced, "question asked", t, {"pa.choices": len(choices)})
            case ev.RulesRetrieved(method=method, hits=hits, seconds=seconds):
                rules = [hit.rule_id for hit in hits]
                about = {"pa.retrieval.method": method, "pa.rules.retrieved": rules}
                self._whole(traced, "retrieve", t, seconds, about)
            case ev.PictureDigested(seconds=seconds):
                self._whole(traced, "picture", t, seconds)
            case ev.PromptBuilt(role=role, attempt=attempt, seconds=seconds):
                about = {"pa.role": role, "pa.attempt": attempt}
                if role == "judge":
                    about["pa.step"] = NUMBERS["judge"]
                self._whole(traced, "prompt", t, seconds, about)
            case ev.PlanProposed(attempt=attempt, author=author, plan=plan, usage=usage):
                about = {
                    "pa.attempt": attempt,
                    "pa.plan.author": author,
                    "pa.plan.readable": plan is not None,
                    "pa.plan.actions": len(plan.actions) if plan is not None else 0,
                    **_sure(event.data.confidence),
                }
                if self._words:
                    about["pa.plan.text"] = event.data.text
                self._asked(traced, "plan", t, usage, about)
            case _:
                pass

    def _examine(self, traced: _MissionSpan, event: ev.Event) -> None:
        """Process an event of steps 5 and 6."""
        t = event.t
        match event.data:
            case ev.PlanRehearsed(attempt=attempt, seconds=seconds):
                self._whole(traced, "rehearse", t, seconds, {"pa.attempt": attempt})
            case ev.PlanChecked(attempt=attempt, findings=findings, seconds=seconds):
                about = {
                    "pa.attempt": attempt,
                    "pa.rules.broken": [f.rule_id for f in findings if f.broken],
                    "pa.rules.blocking": [f.rule_id for f in findings if f.blocking],
                }
                self._whole(traced, "safeguards", t, seconds, about)
            case ev.PlanJudged(attempt=attempt, verdict=verdict, usage=usage, confidence=sure):
                about = {"pa.attempt": attempt, **_verdict(verdict), **_sure(sure)}
                if self._words and verdict is not None:
                    about["pa.judge.feedback"] = verdict.feedback
                self._asked(traced, "judge", t, usage, about)
            case ev.OrderReadAgain(attempt=attempt, model=model, usage=usage):
                about = {"pa.attempt": attempt, "pa.model": model}
                self._asked(traced, "read_again", t, usage, about)
            case ev.RepairRequested(attempt=attempt):
                self._note(traced, "repair requested", t, {"pa.attempt": attempt})
            case _:
                pass

    def _decide(self, traced: _MissionSpan, event: ev.Event) -> None:
        """Process an event of step 7."""
        t = event.t
        match event.data:
            case ev.ApprovalRequested():
                request = event.data
                self._open(
                    traced,
                    "decide",
                    t,
                    {
                        "pa.attempt": request.attempt,
                        "pa.approval.state": request.state or "",
                        "pa.approval.blocked": bool(request.blocked_by),
                        "pa.approval.acknowledge": list(request.acknowledge),
                        "pa.approval.needs_override": request.needs_override,
                    },
                )
            case ev.DecisionMade(decision=decision, accepted=accepted):
                about: dict[str, AttributeValue] = {
                    "pa.decision": decision.kind,
                    "pa.decision.standing": decision.standing,
                    "pa.decision.override": decision.override_judge,
                }
                if self._words:
                    about |= {"pa.decision.by": decision.by, "pa.decision.reason": decision.reason}
                if accepted:
                    self._close(traced, "decide", t, about)
                else:
                    self._note(traced, "decision not accepted", t, about)
            case ev.PlanVoided(attempt=attempt):
                self._note(traced, "plan void", t, {"pa.attempt": attempt})
            case _:
                pass

    def _execute(self, traced: _MissionSpan, event: ev.Event) -> None:
        """Process an event of steps 8 to 10."""
        t = event.t
        match event.data:
            case ev.CommandSent(command=command):
                if "execute" not in traced.open:
                    self._open(traced, "execute", t)
                about = {"pa.agent": command.agent, "pa.command": command.verb}
                traced.open["execute"].add_event("command sent", about, _ns(t))
            case ev.CommandReplied(reply=reply) if "execute" in traced.open:
                about = {"pa.agent": reply.agent, "pa.reply": reply.status}
                traced.open["execute"].add_event("command replied", about, _ns(t))
            case ev.CommandRefused(command=command):
                about = {"pa.agent": command.agent, "pa.command": command.verb}
                self._note(traced, "command refused", t, about)
            case ev.PlanHalted(attempt=attempt):
                self._close(traced, "execute", t, {"pa.attempt": attempt, "pa.halted": True})
            case ev.StepsHeld(orders=orders):
                self._note(traced, "steps held", t, {"pa.orders": list(orders)})
            case ev.MissionVerified(verification=outcome, seconds=seconds):
                self._close(traced, "execute", t)
                self._whole(traced, "verify", t, seconds, {"pa.outcome": outcome.outcome})
            case ev.OutcomeJudged(verdict=verdict, usage=usage):
                self._asked(traced, "outcome", t, usage, _verdict(verdict))
            case ev.MissionReported():
                self._whole(traced, "report", t, 0.0)
            case ev.MissionFinished(status=status, reason=reason, metrics=metrics):
                about: dict[str, AttributeValue] = {
                    "pa.mission.status": status,
                    "pa.mission.attempts": metrics.attempts,
                    "pa.mission.halts": metrics.halts,
                }
                if self._words:
                    about["pa.mission.reason"] = reason
                if status == "failed":
                    traced.root.set_status(StatusCode.ERROR)
                self._end(traced, t, about)
            case _:
                pass

    def _asked(
        self, traced: _MissionSpan, step: Step, t: datetime, usage: Usage, about: Attributes
    ) -> None:
        """Add the span of a step in which a model was used, with its tokens."""
        tokens: dict[str, AttributeValue] = {
            "gen_ai.usage.input_tokens": usage.prompt_tokens,
            "gen_ai.usage.output_tokens": usage.completion_tokens,
            "pa.usage.cached_tokens": usage.cached_tokens,
        }
        if usage.ahead_s:
            tokens["pa.usage.ahead_s"] = usage.ahead_s
        self._whole(traced, step, t, usage.seconds - usage.ahead_s, {**about, **tokens})

    def _whole(
        self,
        traced: _MissionSpan,
        step: Step,
        end: datetime,
        seconds: float,
        about: Attributes | None = None,
    ) -> None:
        """Add the span of a step that is over and took `seconds`."""
        until = _ns(end)
        self._start(traced, step, until - round(seconds * 1e9), about).end(until)

    def _open(
        self, traced: _MissionSpan, step: Step, t: datetime, about: Attributes | None = None
    ) -> None:
        self._close(traced, step, t)
        traced.open[step] = self._start(traced, step, _ns(t), about)

    def _close(
        self, traced: _MissionSpan, step: Step, t: datetime, about: Attributes | None = None
    ) -> None:
        span = traced.open.pop(step, None)
        if span is not None:
            span.set_attributes(about or {})
            span.end(_ns(t))

    def _start(
        self, traced: _MissionSpan, step: Step, start: int, about: Attributes | None
    ) -> Span:
        attributes = {"pa.step": NUMBERS[step], **(about or {})}
        return self._tracer.start_span(
            step, context=traced.context, attributes=attributes, start_time=start
        )

    def _note(
        self, traced: _MissionSpan, name: str, t: datetime, about: Attributes | None = None
    ) -> None:
        if not traced.ended:
            traced.root.add_event(name, about, _ns(t))

    def _end(self, traced: _MissionSpan, t: datetime, about: Attributes) -> None:
        for step in tuple(traced.open):
            self._close(traced, step, t)
        if not traced.ended:
            traced.ended = True
            traced.root.set_attributes(about)
            traced.root.end(_ns(t))


def _ns(t: datetime) -> int:
    """Return nanoseconds since 1970, exact to the microseconds of an event's time."""
    return round(t.timestamp() * 1e6) * 1000


def _sure(confidence: float | None) -> dict[str, AttributeValue]:
    return {} if confidence is None else {"pa.confidence": confidence}


def _verdict(verdict: object) -> dict[str, AttributeValue]:
    return {"pa.verdict": getattr(verdict, "verdict", "none")}
