"""Folds one event of a mission into its trace, step by step of the paper's pipeline."""

from pa_console.schema import event as ev
from pa_console.session.mission_trace import CommandTrace, MissionTrace, Verified


def apply_to_mission(trace: MissionTrace, data: ev.EventPayload) -> None:
    """Take one event of the mission in; a kind that says nothing of it changes nothing."""
    _apply_planning(trace, data)
    _apply_decision(trace, data)
    _apply_execution(trace, data)


def _apply_planning(trace: MissionTrace, data: ev.EventPayload) -> None:
    """Steps 2 to 6."""
    match data:
        case ev.MissionStarted(rules_content_sha256=rules):
            trace.stage, trace.preempted, trace.rules = "retrieve", "", rules
        case ev.WorkflowMoved():
            before = trace.phase
            trace.workflow.append(data)
            if trace.phase != before:
                trace.next_round()
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
            attempt.instead_of, attempt.given = data.instead_of, data.given
            attempt.as_judged, attempt.confidence = data.as_judged, data.confidence
            attempt.as_chosen = data.as_chosen
        case ev.PlanRehearsed(attempt=number, rehearsal=rehearsal, seconds=seconds):
            attempt = trace.attempt(number)
            attempt.rehearsal, attempt.rehearsal_s = rehearsal, seconds
        case ev.PlanChecked(attempt=number, findings=findings, seconds=seconds):
            attempt = trace.attempt(number)
            attempt.findings, attempt.checks_s = findings, seconds
            attempt.unmet, attempt.gaps = data.unmet, data.gaps
        case ev.PlanJudged(attempt=number):
            attempt = trace.attempt(number)
            attempt.verdict, attempt.judge_error = data.verdict, data.error
            attempt.judge_usage, attempt.judged = data.usage, True
            attempt.judge_confidence = data.confidence
        case ev.RepairRequested(attempt=number, reasons=reasons):
            trace.attempt(number).repair = reasons
        case _:
            pass


def _apply_decision(trace: MissionTrace, data: ev.EventPayload) -> None:
    """The operator's turn, and what takes it away."""
    match data:
        case ev.ApprovalRequested(attempt=number, if_halted=declared):
            trace.stage, trace.approval = "decide", data
            if (attempt := trace.find(number)) is not None:
                attempt.if_halted = declared
        case ev.DecisionMade(attempt=number, decision=decision, accepted=accepted):
            trace.decisions.append(data)
            if accepted:
                trace.approval = None
                if decision.kind == "approve":
                    trace.executing = number
        case ev.PlanVoided(reason=reason):
            trace.voided, trace.approval = reason, None
        case ev.MissionPreempted(by=by, reason=reason):
            trace.stage, trace.approval = "queued", None
            trace.preempted = f"{by} goes first: {reason}"
            trace.next_round()
        case _:
            pass


def _apply_execution(trace: MissionTrace, data: ev.EventPayload) -> None:
    """Steps 7 and 8."""
    match data:
        case ev.CommandSent(command=command):
            trace.stage = "execute"
            sent = CommandTrace(command, round=_executing_round(trace))
            trace.commands[command.command_id] = sent
        case ev.CommandReplied(reply=reply) if reply.command_id in trace.commands:
            trace.commands[reply.command_id].replies.append(reply)
        case ev.CommandResent(command_id=name, times=times) if name in trace.commands:
            trace.commands[name].resent = times
        case ev.PlanHalted():
            trace.halts.append(data)
            trace.next_round()
        case ev.MissionVerified(verification=verification):
            trace.stage = "verify"
            trace.verified.append(Verified(verification, _executing_round(trace)))
            trace.next_round()
        case ev.OutcomeJudged(verdict=verdict, error=error) if trace.verified:
            last = trace.verified[-1]
            last.judged, last.verdict, last.error = True, verdict, error
        case ev.OutcomeJudged(verdict=verdict, error=error):
            trace.unasked_verdict, trace.unasked_error = verdict, error
        case ev.MissionReported(text=text):
            trace.stage, trace.report = "report", text
        case ev.MissionFinished(status=status, reason=reason, metrics=metrics):
            trace.stage, trace.approval, trace.preempted = "finished", None, ""
            trace.status, trace.reason, trace.metrics = status, reason, metrics
        case _:
            pass


def _executing_round(trace: MissionTrace) -> int:
    """Return the round of the plan that was approved last."""
    attempt = trace.find(trace.executing)
    return attempt.round if attempt is not None else trace.round
