"""Makes OpenTelemetry spans of a session's events: one trace a mission, one span a step.

A span takes its times from the events, so it is as exact as the log, and whoever makes it need not
be there in time. Nothing here needs more than `opentelemetry-api`.
"""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

from opentelemetry.context import Context
from opentelemetry.trace import Span, StatusCode, Tracer, set_span_in_context
from opentelemetry.util.types import AttributeValue

from pa_console.observability.step_names import NUMBERS, Step
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage

MISSION = "mission"
"""The name of the span that a whole mission is."""
MISSIONS_KEPT = 64
"""So many finished missions are remembered, for verdicts on outcomes that come after them."""

Attributes = Mapping[str, AttributeValue]


@dataclass
class _Traced:
    """The span of one mission, and those of its steps that have not ended."""

    root: Span
    context: Context
    ended: bool = False
    open: dict[Step, Span] = field(default_factory=dict[Step, Span])


class MissionSpans:
    """Turns events into spans of `tracer`; `take` is given every event of a session, in order.

    No attribute holds what an operator typed, what a model wrote, or who decided, unless `words`
    are asked for: names of rules, assets and frames and numbers are all that is told.
    """

    def __init__(self, tracer: Tracer, *, words: bool = False) -> None:
        self._tracer, self._words = tracer, words
        self._session: dict[str, AttributeValue] = {}
        self._missions: OrderedDict[str, _Traced] = OrderedDict()

    def take(self, event: ev.Event) -> None:
        """Take in one event; one of an unknown mission makes no span."""
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
        """Step 1: begin the trace of a mission, which waits in the queue."""
        mission = received.mission
        told: dict[str, AttributeValue] = {
            **self._session,
            "pa.mission.id": name,
            "pa.mission.source": mission.source,
        }
        if self._words:
            told["pa.mission.text"] = mission.said
        root = self._tracer.start_span(
            MISSION, context=Context(), attributes=told, start_time=_ns(t)
        )
        traced = _Traced(root, set_span_in_context(root, Context()))
        self._missions[name] = traced
        self._open(traced, "intake", t, {"pa.queue.position": received.position})
        while len(self._missions) > MISSIONS_KEPT and next(iter(self._missions.values())).ended:
            self._missions.popitem(last=False)

    def _prepare(self, traced: _Traced, event: ev.Event) -> None:
        """Steps 1 to 5: the queue, the rules, the picture, the prompt, the plan."""
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
                told = {"pa.retrieval.method": method, "pa.rules.retrieved": rules}
                self._whole(traced, "retrieve", t, seconds, told)
            case ev.PictureDigested(seconds=seconds):
                self._whole(traced, "picture", t, seconds)
            case ev.PromptBuilt(role=role, attempt=attempt, seconds=seconds):
                told = {"pa.role": role, "pa.attempt": attempt}
                self._whole(traced, "prompt", t, seconds, told)
            case ev.PlanProposed(attempt=attempt, author=author, plan=plan, usage=usage):
                told = {
                    "pa.attempt": attempt,
                    "pa.plan.author": author,
                    "pa.plan.readable": plan is not None,
                    "pa.plan.actions": len(plan.actions) if plan is not None else 0,
                    **_sure(event.data.confidence),
                }
                if self._words:
                    told["pa.plan.text"] = event.data.text
                self._asked(traced, "plan", t, usage, told)
            case _:
                pass

    def _examine(self, traced: _Traced, event: ev.Event) -> None:
        """Step 6 as far as machines do it."""
        t = event.t
        match event.data:
            case ev.PlanRehearsed(attempt=attempt, seconds=seconds):
                self._whole(traced, "rehearse", t, seconds, {"pa.attempt": attempt})
            case ev.PlanChecked(attempt=attempt, findings=findings, seconds=seconds):
                told = {
                    "pa.attempt": attempt,
                    "pa.rules.broken": [f.rule_id for f in findings if f.broken],
                    "pa.rules.blocking": [f.rule_id for f in findings if f.blocking],
                }
                self._whole(traced, "safeguards", t, seconds, told)
            case ev.PlanJudged(attempt=attempt, verdict=verdict, usage=usage, confidence=sure):
                told = {"pa.attempt": attempt, **_verdict(verdict), **_sure(sure)}
                if self._words and verdict is not None:
                    told["pa.judge.feedback"] = verdict.feedback
                self._asked(traced, "judge", t, usage, told)
            case ev.OrderReadAgain(attempt=attempt, model=model, usage=usage):
                told = {"pa.attempt": attempt, "pa.model": model}
                self._asked(traced, "read_again", t, usage, told)
            case ev.RepairRequested(attempt=attempt):
                self._note(traced, "repair requested", t, {"pa.attempt": attempt})
            case _:
                pass

    def _decide(self, traced: _Traced, event: ev.Event) -> None:
        """Step 6 as far as a person does it."""
        t = event.t
        match event.data:
            case ev.ApprovalRequested():
                asked = event.data
                self._open(
                    traced,
                    "decide",
                    t,
                    {
                        "pa.attempt": asked.attempt,
                        "pa.approval.state": asked.state or "",
                        "pa.approval.blocked": bool(asked.blocked_by),
                        "pa.approval.acknowledge": list(asked.acknowledge),
                        "pa.approval.needs_override": asked.needs_override,
                    },
                )
            case ev.DecisionMade(decision=decision, accepted=accepted):
                told: dict[str, AttributeValue] = {
                    "pa.decision": decision.kind,
                    "pa.decision.standing": decision.standing,
                    "pa.decision.override": decision.override_judge,
                }
                if self._words:
                    told |= {"pa.decision.by": decision.by, "pa.decision.reason": decision.reason}
                if accepted:
                    self._close(traced, "decide", t, told)
                else:
                    self._note(traced, "decision not accepted", t, told)
            case ev.PlanVoided(attempt=attempt):
                self._note(traced, "plan void", t, {"pa.attempt": attempt})
            case _:
                pass

    def _execute(self, traced: _Traced, event: ev.Event) -> None:
        """Steps 7 and 8."""
        t = event.t
        match event.data:
            case ev.CommandSent(command=command):
                if "execute" not in traced.open:
                    self._open(traced, "execute", t)
                told = {"pa.agent": command.agent, "pa.command": command.verb}
                traced.open["execute"].add_event("command sent", told, _ns(t))
            case ev.CommandReplied(reply=reply) if "execute" in traced.open:
                told = {"pa.agent": reply.agent, "pa.reply": reply.status}
                traced.open["execute"].add_event("command replied", told, _ns(t))
            case ev.CommandRefused(command=command):
                told = {"pa.agent": command.agent, "pa.command": command.verb}
                self._note(traced, "command refused", t, told)
            case ev.PlanHalted(attempt=attempt):
                self._close(traced, "execute", t, {"pa.attempt": attempt, "pa.halted": True})
            case ev.MissionVerified(verification=found, seconds=seconds):
                self._close(traced, "execute", t)
                self._whole(traced, "verify", t, seconds, {"pa.outcome": found.outcome})
            case ev.OutcomeJudged(verdict=verdict, usage=usage):
                self._asked(traced, "outcome", t, usage, _verdict(verdict))
            case ev.MissionReported():
                self._whole(traced, "report", t, 0.0)
            case ev.MissionFinished(status=status, reason=reason, metrics=metrics):
                told: dict[str, AttributeValue] = {
                    "pa.mission.status": status,
                    "pa.mission.attempts": metrics.attempts,
                    "pa.mission.halts": metrics.halts,
                }
                if self._words:
                    told["pa.mission.reason"] = reason
                if status == "failed":
                    traced.root.set_status(StatusCode.ERROR)
                self._end(traced, t, told)
            case _:
                pass

    def _asked(
        self, traced: _Traced, step: Step, t: datetime, usage: Usage, told: Attributes
    ) -> None:
        """Tell of a step in which a model was asked, and what that cost."""
        tokens: dict[str, AttributeValue] = {
            "gen_ai.usage.input_tokens": usage.prompt_tokens,
            "gen_ai.usage.output_tokens": usage.completion_tokens,
            "pa.usage.cached_tokens": usage.cached_tokens,
        }
        self._whole(traced, step, t, usage.seconds, {**told, **tokens})

    def _whole(
        self,
        traced: _Traced,
        step: Step,
        end: datetime,
        seconds: float,
        told: Attributes | None = None,
    ) -> None:
        """Tell of a step that is over and has taken so many `seconds`."""
        until = _ns(end)
        self._start(traced, step, until - round(seconds * 1e9), told).end(until)

    def _open(
        self, traced: _Traced, step: Step, t: datetime, told: Attributes | None = None
    ) -> None:
        self._close(traced, step, t)
        traced.open[step] = self._start(traced, step, _ns(t), told)

    def _close(
        self, traced: _Traced, step: Step, t: datetime, told: Attributes | None = None
    ) -> None:
        span = traced.open.pop(step, None)
        if span is not None:
            span.set_attributes(told or {})
            span.end(_ns(t))

    def _start(self, traced: _Traced, step: Step, start: int, told: Attributes | None) -> Span:
        attributes = {"pa.step": NUMBERS[step], **(told or {})}
        return self._tracer.start_span(
            step, context=traced.context, attributes=attributes, start_time=start
        )

    def _note(
        self, traced: _Traced, name: str, t: datetime, told: Attributes | None = None
    ) -> None:
        if not traced.ended:
            traced.root.add_event(name, told, _ns(t))

    def _end(self, traced: _Traced, t: datetime, told: Attributes) -> None:
        for step in tuple(traced.open):
            self._close(traced, step, t)
        if not traced.ended:
            traced.ended = True
            traced.root.set_attributes(told)
            traced.root.end(_ns(t))


def _ns(t: datetime) -> int:
    """Return nanoseconds since 1970, exact to the microseconds that an event has."""
    return round(t.timestamp() * 1e6) * 1000


def _sure(confidence: float | None) -> dict[str, AttributeValue]:
    return {} if confidence is None else {"pa.confidence": confidence}


def _verdict(verdict: object) -> dict[str, AttributeValue]:
    return {"pa.verdict": getattr(verdict, "verdict", "none")}
