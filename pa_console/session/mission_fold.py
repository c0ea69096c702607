"""The fold of a mission: the changes that each event makes to the mission's trace."""

from pa_console.schema.events import event as ev
from pa_console.session.mission_trace import CommandTrace, MissionTrace, VerifiedPlan


def apply_to_mission(trace: MissionTrace, data: ev.EventPayload) -> None:
    """Apply one event of the mission; other kinds of events change nothing."""
    _apply_reading(trace, data)
    _apply_planning(trace, data)
    _apply_decision(trace, data)
    _apply_execution(trace, data)


def withhold_approval(trace: MissionTrace, before: str, refusal: str) -> None:
    """Block the waiting plan, because its station may not command; the reason is `refusal`.

    The new refusal replaces the one `before`; '' removes the block.
    """
    request = trace.approval
    if request is None or trace.approval_state in ("blocked", "not_understood"):
        return
    others = tuple(why for why in request.blocked_by if why != before)
    changes = {
        "blocked_by": (*others, refusal) if refusal else others,
        "state": "blocked" if refusal else trace.approval_state,
    }
    trace.approval = request.model_copy(update=changes)


def _apply_reading(trace: MissionTrace, data: ev.EventPayload) -> None:
    """Apply an event about the reading of the order, or about a question."""
    match data:
        case ev.QuestionAsked():
            trace.questions.append(data)
        case ev.QuestionAnswered():
            trace.answers.append(data)
        case ev.OrderRead(text=text, typed=typed, references=references, follows=follows):
            words = {"text": text, "typed": typed if typed != text else "", "follows": follows}
            trace.mission = trace.mission.model_copy(update=words)
            trace.references = references
        case ev.OrderStepRead(step=step, steps=steps, text=text):
            trace.step = f"step {step} of {steps}: {text}"
        case ev.StandingOrderRead():
            trace.standing = data
        case _:
            pass


def _apply_prompt(trace: MissionTrace, data: ev.PromptBuilt) -> None:
    """Begin an answer of the planner or judge, which replaces an interrupted answer."""
    if data.role == "planner":
        attempt, trace.stage = trace.attempt(data.attempt), "plan"
        attempt.system, attempt.user, attempt.text = data.system, data.user, ""
        attempt.server = data.server
    elif data.role == "judge":
        trace.stage = "judge"
        if (judged := trace.find(data.attempt)) is not None:
            judged.judge_text = ""


def _apply_planning(trace: MissionTrace, data: ev.EventPayload) -> None:
    """Apply an event of the steps from retrieval to the judge's verdict."""
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
        case ev.PromptBuilt():
            _apply_prompt(trace, data)
        case ev.TextStreamed(role=role, attempt=number, text=text):
            attempt = trace.attempt(number)
            if role == "planner":
                attempt.text += text
            else:
                attempt.judge_text += text
        case ev.PlanProposed(attempt=number):
            trace.stage = "safeguards"
            trace.step = "" if data.author == "console" else trace.step
            attempt = trace.attempt(number)
            attempt.author, attempt.text, attempt.plan = data.author, data.text, data.plan
            attempt.error, attempt.usage = data.error, data.usage
            attempt.instead_of, attempt.given = data.instead_of, data.given
            attempt.as_judged, attempt.confidence = data.as_judged, data.confidence
            attempt.as_chosen, attempt.as_read_again = data.as_chosen, data.as_read_again
        case ev.PlanRehearsed(attempt=number, rehearsal=rehearsal, seconds=seconds):
            attempt = trace.attempt(number)
            if attempt.made_s is None:
                attempt.made_s = rehearsal.before.time_s
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
    """Apply a second reading, a request for approval, or an event that ends the request."""
    match data:
        case ev.OrderReadAgain(attempt=number):
            trace.attempt(number).read_again = data
        case ev.ApprovalRequested(attempt=number, if_halted=declared):
            trace.stage, trace.approval = "decide", data
            trace.approval_state, trace.offered = data.state, data.readings
            if (attempt := trace.find(number)) is not None:
                attempt.if_halted, attempt.shown_confidence = declared, data.confidence
                attempt.gaps = data.gaps or attempt.gaps
        case ev.DecisionMade(attempt=number, decision=decision, accepted=accepted):
            trace.decisions.append(data)
            if accepted:
                trace.approval = None
                if decision.kind == "approve":
                    trace.executing = number
        case ev.CameraStill() if trace.approval is not None:
            trace.stills[trace.approval.attempt] = data
        case ev.PlanVoided(attempt=number, reason=reason):
            trace.voided, trace.voided_attempt, trace.approval = reason, number, None
        case ev.MissionPreempted(by=by, reason=reason):
            trace.stage, trace.approval = "queued", None
            trace.preempted = f"{by} goes first: {reason}"
            trace.next_round()
        case _:
            pass


def _apply_execution(trace: MissionTrace, data: ev.EventPayload) -> None:
    """Apply an event of the steps from execution to the report."""
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
        case ev.StepsHeld():
            trace.held.append(data)
        case ev.MissionVerified(verification=verification, step=step):
            trace.stage = "verify"
            verified = VerifiedPlan(verification, _executing_round(trace), trace.executing, step)
            trace.verified.append(verified)
            trace.next_round()
        case ev.OutcomeJudged(attempt=number, verdict=verdict, error=error, usage=usage):
            if (judged := trace.find_verified(number)) is not None:
                judged.judged, judged.verdict, judged.error = True, verdict, error
                judged.judging_s = usage.seconds
                _measure_verdicts(trace)
            else:
                trace.unasked_verdict, trace.unasked_error = verdict, error
        case ev.MissionReported(text=text):
            trace.stage, trace.report = "report", text
        case ev.MissionFinished(status=status, reason=reason, metrics=metrics):
            trace.stage, trace.approval, trace.preempted = "finished", None, ""
            trace.status, trace.reason, trace.metrics = status, reason, metrics
            for attempt in trace.attempts:
                attempt.pack()
            _measure_verdicts(trace)
        case _:
            pass


def _measure_verdicts(trace: MissionTrace) -> None:
    """Add the time of the verdicts on outcomes to the metrics, once the trace has metrics."""
    if trace.metrics is not None:
        taken = sum(verified.judging_s for verified in trace.verified)
        outcome_s = max(trace.metrics.outcome_s, taken)
        trace.metrics = trace.metrics.model_copy(update={"outcome_s": outcome_s})


def _executing_round(trace: MissionTrace) -> int:
    """Return the round of the last approved plan."""
    attempt = trace.find(trace.executing)
    return attempt.round if attempt is not None else trace.round
