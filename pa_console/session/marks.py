"""What a viewer of a recording jumps to: missions, alarms, findings, refusals and faults."""

from typing import Literal, get_args

from pa_console.schema import event as ev
from pa_console.schema.incident import Incident
from pa_console.session.fold import SessionState
from pa_console.session.wording import overriding

MarkKind = Literal["fault", "refusal", "alarm", "finding", "mission"]
"""Worst first: where several fall on one place, the first is shown."""

MARK_KINDS: tuple[MarkKind, ...] = get_args(MarkKind)
_NO_FAULTS = frozenset(("spawn", "restore", "weather", "turn", "place", "clear"))


def mark_of(event: ev.Event, before: SessionState) -> MarkKind | None:
    """Return what `event`, which comes after the state `before`, is worth a jump for."""
    found: MarkKind | None = None
    if _is_fault(event.data):
        found = "fault"
    elif _is_refusal(event.data):
        found = "refusal"
    elif _is_finding(event.data):
        found = "finding"
    elif isinstance(event.data, ev.MissionReceived):
        found = "mission"
    elif isinstance(event.data, ev.AlarmRaised) and before.is_worse(event.data.alarm):
        found = "alarm"
    return found


def _is_finding(data: ev.EventPayload) -> bool:
    """Whether a check, the judge or telemetry objects, or the operator decided otherwise."""
    match data:
        case ev.PlanChecked(findings=findings):
            return any(finding.broken for finding in findings)
        case ev.PlanJudged(verdict=verdict) | ev.OutcomeJudged(verdict=verdict):
            return verdict is None or verdict.verdict == "Failure"
        case ev.MissionVerified(verification=verification):
            return verification.outcome == "fail"
        case ev.DecisionMade(accepted=True, decision=decision):
            return bool(overriding(decision))
        case _:
            return False


def _is_refusal(data: ev.EventPayload) -> bool:
    """Whether a plan may not be approved, or was not, or a decision was not taken."""
    match data:
        case ev.ApprovalRequested(blocked_by=blocked):
            return bool(blocked)
        case ev.DecisionMade(accepted=accepted, decision=decision):
            return not accepted or decision.kind == "reject"
        case ev.MissionFinished(status=status):
            return status == "refused"
        case _:
            return False


def _is_fault(data: ev.EventPayload) -> bool:
    """Whether something broke, or was stopped because of it."""
    match data:
        case ev.IncidentHappened(incident=incident):
            return _breaks(incident)
        case ev.WorkerChanged(state=state):
            return state in ("dead", "unavailable")
        case ev.CommandReplied(reply=reply):
            return reply.status in ("failed", "refused")
        case _:
            return isinstance(data, ev.PlanHalted | ev.AllStopped | ev.CommandRefused)


def _breaks(incident: Incident) -> bool:
    """Whether an incident makes something worse; what mends, appears or is placed does not."""
    match incident.kind:
        case "comms":
            return incident.comms != "ok"
        case "radio":
            return not incident.up or incident.loss > 0
        case "sensor":
            return not incident.works
        case "gps":
            return incident.rate_mps > 0
        case "spoof":
            return incident.frame is not None
        case _:
            return incident.kind not in _NO_FAULTS
