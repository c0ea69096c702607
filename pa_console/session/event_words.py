"""Says in one short line what an event tells, for lists of events and for comparisons."""

from pa_console.schema import event as ev
from pa_console.schema.plan import Plan
from pa_console.session.reading_words import meant
from pa_console.session.wording import in_words, order_in_words, overriding, safety_in_words


def kind_in_words(kind: str) -> str:
    """Return the name of a kind of event as words."""
    return kind.replace("_", " ")


def event_in_words(data: ev.EventPayload) -> str:
    """Return what an event says beyond its kind; empty where the kind says it all."""
    said = ""
    match data:
        case ev.SessionStarted():
            said = f"{data.world}, {data.rules}, {data.model}, seed {data.seed}"
        case ev.RulesReplaced(changes=changes):
            said = "; ".join(changes)
        case ev.TelemetryReceived(picture=picture):
            said = f"at {picture.time_s:g} s"
        case ev.IncidentHappened(incident=incident):
            said = in_words(incident)
        case ev.Noticed(subject=subject, text=text):
            said = f"{subject}: {text}"
        case ev.WorkerChanged(state=state, detail=detail):
            said = f"{state} {detail}".strip()
        case ev.AlarmRaised(alarm=alarm):
            said = f"{alarm.priority}: {alarm.text}"
        case ev.AlarmAcknowledged(alarm_id=name, by=who):
            said = f"{name} by {who}"
        case ev.AlarmCleared(alarm_id=name, reason=reason):
            said = f"{name}: {reason}"
        case ev.MissionReceived(mission=mission):
            said = mission.text
        case ev.MissionPreempted(by=who, reason=reason):
            said = f"{who} goes first: {reason}"
        case ev.WorkflowMoved():
            step = data.phases[data.phase] if 0 <= data.phase < len(data.phases) else data.outcome
            said = f"{data.track}: {step}"
        case ev.RulesRetrieved(hits=hits):
            said = ", ".join(hit.rule_id for hit in hits)
        case ev.PromptBuilt(role=role, attempt=attempt):
            said = f"{role}, attempt {attempt}"
        case ev.QueueChanged(entries=entries):
            said = ", ".join(entry.mission.id for entry in entries) or "empty"
        case _:
            said = _planned(data) or _done(data)
    return said


def _planned(data: ev.EventPayload) -> str:
    """Return the words of steps 5 and 6."""
    said = ""
    match data:
        case ev.PlanProposed(plan=plan, error=error):
            said = _plan(plan) if plan is not None else error
        case ev.PlanChecked(findings=findings, unmet=unmet):
            broken = [finding.rule_id for finding in findings if finding.broken]
            said = f"broken: {', '.join(broken)}" if broken else "no rule broken"
            said += "".join(f"; not met: {text}" for text in unmet)
        case (
            ev.PlanJudged(verdict=verdict, error=error)
            | ev.OutcomeJudged(verdict=verdict, error=error)
        ):
            said = f"{verdict.verdict}: {verdict.feedback}" if verdict is not None else error
        case ev.RepairRequested(reasons=reasons):
            said = "; ".join(reasons)
        case ev.ApprovalRequested(blocked_by=blocked, plan=plan, readings=readings):
            said = f"blocked: {'; '.join(blocked)}" if blocked else _plan(plan)
            said += f" | if halted: {safety_in_words(data.if_halted)}" if data.if_halted else ""
            said += "".join(f" | or: {meant(asked)}" for asked in readings)
        case ev.DecisionMade(decision=decision, accepted=accepted, detail=detail):
            taken = "" if accepted else f", not accepted: {detail}"
            said = f"{decision.kind} by {decision.by} {decision.reason}".strip()
            if otherwise := overriding(decision):
                said = f"{decision.kind}: {otherwise}"
            said += taken
        case ev.PlanVoided(reason=reason):
            said = reason
        case _:
            pass
    return said


def _done(data: ev.EventPayload) -> str:
    """Return the words of steps 7 and 8, and of the session's end."""
    said = ""
    match data:
        case ev.CommandSent(command=command):
            said = f"{command.agent}: {order_in_words(command)}"
        case ev.CommandRefused(command=command, reason=reason):
            said = f"{command.agent}: {order_in_words(command)}: {reason}"
        case ev.CommandReplied(reply=reply):
            said = f"{reply.agent}: {reply.status} {reply.detail}".strip()
        case ev.CommandResent(command_id=name, times=times):
            said = f"{name}, {times} times"
        case ev.PlanHalted(reasons=reasons):
            said = "; ".join(reasons)
        case ev.MissionVerified(verification=verification):
            said = f"{verification.outcome} {verification.reason}".strip()
        case ev.MissionReported(text=text):
            said = " ".join(text.split())
        case ev.MissionFinished(status=status, reason=reason):
            said = f"{status}: {reason}"
        case ev.AllStopped(by=who) | ev.StopReleased(by=who):
            said = f"by {who}"
        case ev.SessionEnded(reason=reason):
            said = reason
        case _:
            pass
    return said


def _plan(plan: Plan) -> str:
    return "; ".join(f"{action.agent} {action.command}" for action in plan.actions) or "no action"
