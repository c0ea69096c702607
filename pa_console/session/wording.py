"""Events, incidents, orders and decisions in words, one short line each."""

import re
from collections.abc import Collection, Sequence

from pa_console.orders.plain_words import plain_reading
from pa_console.schema.alarm import Alarm
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.incident import Incident, Reaction, RevealTrack, SpawnTrack
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action, Plan
from pa_console.schema.standing import StandingOrder
from pa_console.schema.telemetry import Picture, TrackStatus
from pa_console.session.status_words import status_of

_TEMPLATES: dict[str, str] = {
    "spawn": "a {track} appears on the lane to {gate}",
    "fail": "{asset} has stopped working",
    "restore": "{asset} works again",
    "degrade": "{asset} runs at {speed_factor:.0%} of its speed",
    "battery": "battery of {asset} reads {percent:g} %",
    "comms": "link of {asset} {state}",
    "radio": "link of {asset} {state}",
    "jam": "links within {radius_m:g} m of ({at[0]:g}, {at[1]:g}) are jammed",
    "sensor": "sensor {sensor} {state}",
    "gps": "position of {asset} drifts by {rate_mps:g} m/s",
    "spoof": "telemetry of {asset} is forged",
    "weather": "weather: {weather}",
    "obstruct": "the way is obstructed at ({start[0]:g}, {start[1]:g})",
    "phantom": "a sensor at {gate} reports what is not there",
    "turn": "the truth behind {track} changes",
    "worker": "the model's worker process is killed",
    "place": "{asset} is placed at {frame}",
    "clear": "all tracks at {gate} are gone",
}
_LINK = {"ok": "works", "degraded": "is degraded", "lost": "is lost"}
_REACTIONS: dict[Reaction, str] = {
    "leave": "leaves when warned",
    "stop": "stops when warned",
    "go_on": "goes on when warned",
}


TRACK_PLACES: dict[TrackStatus, str] = {
    "approaching": "is approaching {gate}",
    "stopped": "has stopped at {gate}",
    "inside": "has passed {gate}",
    "leaving": "is leaving {gate}",
}
"""The place of a track in words with its gate, by its status."""

_PLACE = re.compile(r"\b(?:is approaching|has stopped at|has passed|is leaving) ")
_DISTANCE = re.compile(r"\d+ m\Z")


def alarm_now(alarm: Alarm, picture: Picture | None) -> Alarm:
    """Return `alarm` with the present place and distance of its track in the picture."""
    track = picture.tracks.get(alarm.subject) if picture is not None else None
    if track is None or alarm.distance_m is None:
        return alarm
    place = TRACK_PLACES[track.status].format(gate="")
    text = _DISTANCE.sub(f"{track.distance_m:.0f} m", _PLACE.sub(place, alarm.text, count=1))
    return alarm.model_copy(update={"text": text, "distance_m": track.distance_m})


def in_words(incident: Incident) -> str:
    """Return `incident` as an operator can observe it; the truth behind a track stays hidden."""
    values = incident.model_dump()
    match incident.kind:
        case "comms":
            values["state"] = _LINK[incident.comms]
        case "radio":
            values["asset"] = incident.asset or "every asset"
            lossy = f"loses {incident.loss:.0%} of its messages"
            values["state"] = lossy if incident.up else "is down"
        case "sensor":
            values["state"] = "works again" if incident.works else "has stopped working"
        case _:
            pass
    return _TEMPLATES[incident.kind].format_map(values)


def truth_in_words(incident: Incident) -> str:
    """Return all of `incident`, with the truth behind a track, for the reader of a script."""
    match incident:
        case SpawnTrack(name=name, track=track, gate=gate):
            who = f"a {track}{f' ({name})' if name else ''} appears on the lane to {gate}"
        case RevealTrack(track=track):
            who = f"{track} from now on"
        case _:
            return in_words(incident)
    truth = [known for known in (incident.identity, incident.intent) if known]
    truth += [_REACTIONS[incident.when_warned]] if incident.when_warned else []
    return f"{who}: {', '.join(truth)}" if truth else who


def overriding(decision: Decision) -> str:
    """Return the operator's deviations from the console's proposal; empty if there are none.

    A deviation is a changed plan, another reading of the order, an overridden objection of the
    judge, or an accepted breach.
    """
    said: list[str] = []
    if decision.kind == "modify":
        said.append("the plan was changed")
    if decision.kind == "choose":
        said.append(f"the order was read as “{plain_reading(decision.asked)}”")
    if decision.kind == "approve" and decision.override_judge:
        said.append("the judge was overridden")
    if decision.kind == "approve" and decision.acknowledged:
        said.append(f"broken {', '.join(decision.acknowledged)} accepted")
    if not said:
        return ""
    return f"{', '.join(said)} by {decision.by}" + (
        f": {decision.reason}" if decision.reason else ""
    )


def safety_in_words(declared: Sequence[Action]) -> str:
    """Return a plan's declared way to safety: the assets that go back, and those that hold."""
    parts = [
        f"{action.agent} back to {action.target} (holds if another covers it by then)"
        for action in declared
        if action.target is not None
    ]
    holding = [action.agent for action in declared if action.target is None]
    if holding:
        parts.append(f"{', '.join(holding)} {'hold' if len(holding) > 1 else 'holds'}")
    return "; ".join(parts)


def order_in_words(command: DeviceCommand | Action) -> str:
    """Return a command as a plan has it: `move_to EastGate`."""
    return f"{command.verb} {command.target or ''}".strip()


def references_in_words(references: Sequence[ev.Reference]) -> str:
    """Return the references of an order with their meanings: *"it" = Drone_T04*."""
    return "; ".join(f"“{one.said}” = {one.means}" for one in references)


def standing_in_words(order: StandingOrder) -> str:
    """Return a standing order in plain words, in one line."""
    return f"{order.id}: whenever {order.words}: {order.order_in_words}"


def asked_in_words(order: StandingOrder, allowed: Collection[str] | None = None) -> str:
    """Return the approval that missions started by `order` need.

    `allowed` are the commands that the rules let it start unasked; None if they are unknown.
    """
    if not order.unasked:
        return "each mission waits for your approval"
    if allowed is None:
        return "nobody is asked where the rules allow that"
    if not allowed:
        return "it says that nobody need be asked; the rules do not allow that: you are asked"
    return f"unasked where a plan only gives {', '.join(allowed)}; else you are asked"


def answer_in_words(answer: ev.QuestionAnswered) -> str:
    """Return a question and its answer in one line."""
    lines = "; ".join(f"{line.about}: {line.said}" for line in answer.lines)
    return f"“{answer.question}” {lines}".strip()


def kind_in_words(kind: str) -> str:
    """Return the name of a kind of event as words."""
    return kind.replace("_", " ")


def event_in_words(data: ev.EventPayload) -> str:
    """Return the content of an event beyond its kind; empty for a kind without content."""
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
        case ev.ServerChanged(server=server, state=state, detail=detail):
            said = f"{server} {state}: {detail}"
        case ev.AlarmRaised(alarm=alarm):
            said = f"{alarm.priority}: {alarm.text}"
        case ev.AlarmAcknowledged(alarm_id=name, by=who):
            said = f"{name} by {who}"
        case ev.AlarmCleared(alarm_id=name, reason=reason):
            said = f"{name}: {reason}"
        case ev.MissionReceived(mission=mission):
            said = mission.said
        case ev.QuestionAsked(question=question, choices=choices):
            said = f"{question} {' | '.join(choices)}".strip()
        case ev.QuestionAnswered():
            said = answer_in_words(data)
        case ev.OrderRead(text=text, references=references):
            said = f"{text} | {references_in_words(references)}"
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
            said = _standing(data) or _planned(data) or _done(data) or _of_tak(data)
    return said


def _of_tak(data: ev.EventPayload) -> str:
    """Return the words of what comes from a TAK server."""
    said = ""
    match data:
        case ev.TakChanged(detail=detail):
            said = detail
        case ev.ContactReported(contact=contact):
            said = contact_in_words(contact)
        case ev.ContactLost(uid=uid, reason=reason):
            said = f"{uid}: {reason}"
        case ev.ContactsLeftOut():
            said = (
                f"{data.outside} beyond the site, {data.too_many} too many, "
                f"{data.unreadable} unreadable"
            )
        case _:
            pass
    return said


def contact_in_words(contact: ev.ReportedContact) -> str:
    """Return the claims about a contact: *“ALPHA-1”, said to be a friend, vehicle, at (12, -3)*."""
    x, y = contact.at
    claimed = f"said to be {contact.affiliation}, {contact.what}"
    return f"“{contact.name}”, {claimed}, at ({x:.0f}, {y:.0f})"


def _standing(data: ev.EventPayload) -> str:
    """Return the words of what standing orders do."""
    said = ""
    match data:
        case ev.StandingOrderRead(order=order) | ev.StandingOrderApproved(order=order):
            said = standing_in_words(order)
        case ev.StandingOrderStarted(order_id=name, subject=subject):
            said = f"by {name} for {subject}"
        case ev.StandingOrderWithheld(order_id=name, subject=subject, reason=reason):
            said = f"{name}{f' for {subject}' if subject else ''}: {reason}"
        case ev.StandingOrderRevoked(order_id=name, by=who, reason=reason):
            said = f"{name} by {who}{f': {reason}' if reason else ''}"
        case _:
            pass
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
        case ev.OrderReadAgain(model=model, asked=asked, error=error):
            said = f"{model}: {error or plain_reading(asked)}"
        case ev.RepairRequested(reasons=reasons):
            said = "; ".join(reasons)
        case ev.ApprovalRequested(blocked_by=blocked, plan=plan, readings=readings):
            said = "; ".join(blocked) if blocked else _plan(plan)
            said = f"{_state(data)}{said}"
            said += f" | if halted: {safety_in_words(data.if_halted)}" if data.if_halted else ""
            said += "".join(f" | or: {plain_reading(asked)}" for asked in readings)
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


def _state(request: ev.ApprovalRequested) -> str:
    """Return the state of a request in words; empty for one that can be plainly approved."""
    if request.state == "not_understood":
        return ""  # its one reason says so
    if request.blocked_by:
        return "blocked: "
    told = request.state not in (None, "approve")
    return f"{status_of('approval', request.state or '').word.lower()}: " if told else ""


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
        case ev.SessionResumed(interrupted=interrupted):
            said = f"ended as held: {', '.join(interrupted)}" if interrupted else ""
        case ev.AuthorityChanged(refusal=refusal):
            said = f"nothing is sent from here: {refusal}" if refusal else "in command"
        case ev.CommandTaken():
            said = command_taken_in_words(data)
        case _:
            pass
    return said


def command_taken_in_words(taken: ev.CommandTaken) -> str:
    """Return the station that lost command, and the last record of its log."""
    return (
        f"taken from {taken.station} by {taken.by}, epoch {taken.epoch}; its session "
        f"{taken.session} had come to record {taken.records}, hash {taken.head[:12]}"
    )


def _plan(plan: Plan) -> str:
    return "; ".join(f"{action.agent} {action.command}" for action in plan.actions) or "no action"
