"""Events, incidents, orders and decisions in words, one short line each."""

import re
from collections.abc import Collection, Mapping, Sequence

from pa_console.language.plain_words import plain_reading
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


def incident_in_words(incident: Incident) -> str:
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


def incident_truth_in_words(incident: Incident) -> str:
    """Return all of `incident`, with the truth behind a track, for the reader of a script."""
    match incident:
        case SpawnTrack(name=name, track=track, gate=gate):
            who = f"a {track}{f' ({name})' if name else ''} appears on the lane to {gate}"
        case RevealTrack(track=track):
            who = f"{track} from now on"
        case _:
            return incident_in_words(incident)
    truth = [known for known in (incident.identity, incident.intent) if known]
    truth += [_REACTIONS[incident.when_warned]] if incident.when_warned else []
    return f"{who}: {', '.join(truth)}" if truth else who


def deviations_in_words(decision: Decision) -> str:
    """Return the operator's deviations from the console's proposal; empty if there are none.

    A deviation is a changed plan, another reading of the order, an overridden objection of the
    judge, or an accepted breach.
    """
    words: list[str] = []
    if decision.kind == "modify":
        words.append("the plan was changed")
    if decision.kind == "choose":
        words.append(f"the order was read as “{plain_reading(decision.asked)}”")
    if decision.kind == "approve" and decision.override_judge:
        words.append("the judge was overridden")
    if decision.kind == "approve" and decision.acknowledged:
        words.append(f"broken {', '.join(decision.acknowledged)} accepted")
    if not words:
        return ""
    return f"{', '.join(words)} by {decision.by}" + (
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
        return "no approval is asked for where the rules allow it"
    if not allowed:
        return "it asks for no approval, which the rules do not allow: you are asked"
    return f"unasked where a plan only gives {', '.join(allowed)}; else you are asked"


def answer_in_words(answer: ev.QuestionAnswered) -> str:
    """Return a question and its answer in one line."""
    lines = "; ".join(f"{line.about}: {line.said}" for line in answer.lines)
    return f"“{answer.question}” {lines}".strip()


def kind_in_words(kind: str) -> str:
    """Return the name of a kind of event as words."""
    return kind.replace("_", " ")


_EVENT_TEMPLATES: dict[str, str] = {
    "session_started": "{world}, {rules}, {model}, seed {seed}",
    "telemetry": "at {picture.time_s:g} s",
    "noticed": "{subject}: {text}",
    "worker": "{state} {detail}",
    "server": "{server} {state}: {detail}",
    "alarm_raised": "{alarm.priority}: {alarm.text}",
    "alarm_acknowledged": "{alarm_id} by {by}",
    "alarm_cleared": "{alarm_id}: {reason}",
    "mission_received": "{mission.said}",
    "mission_preempted": "{by} goes first: {reason}",
    "prompt_built": "{role}, attempt {attempt}",
    "standing_order_started": "by {order_id} for {subject}",
    "plan_voided": "{reason}",
    "command_replied": "{reply.agent}: {reply.status} {reply.detail}",
    "command_resent": "{command_id}, {times} times",
    "mission_verified": "{verification.outcome} {verification.reason}",
    "mission_finished": "{status}: {reason}",
    "all_stopped": "by {by}",
    "stop_released": "by {by}",
    "session_ended": "{reason}",
    "tak": "{detail}",
    "contact_lost": "{uid}: {reason}",
    "contacts_left_out": "{outside} beyond the site, {too_many} too many, {unreadable} unreadable",
}


def event_in_words(data: ev.EventPayload) -> str:
    """Return the content of an event beyond its kind; empty for a kind without content."""
    if template := _EVENT_TEMPLATES.get(data.kind):
        return template.format_map(vars(data)).strip()
    return _session_event(data) or _planning_event(data) or _execution_event(data)


def _session_event(data: ev.EventPayload) -> str:
    """Return the words of events of the session, its queue, standing orders and contacts."""
    words = ""
    match data:
        case ev.RulesReplaced(changes=changes):
            words = "; ".join(changes)
        case ev.IncidentHappened(incident=incident):
            words = incident_in_words(incident)
        case ev.QueueChanged(entries=entries):
            words = ", ".join(entry.mission.id for entry in entries) or "empty"
        case ev.QuestionAnswered():
            words = answer_in_words(data)
        case ev.ContactReported(contact=contact):
            words = contact_in_words(contact)
        case ev.StandingOrderRead(order=order) | ev.StandingOrderApproved(order=order):
            words = standing_in_words(order)
        case ev.StandingOrderWithheld(order_id=name, subject=subject, reason=reason):
            words = f"{name}{f' for {subject}' if subject else ''}: {reason}"
        case ev.StandingOrderRevoked(order_id=name, by=by, reason=reason):
            words = f"{name} by {by}{f': {reason}' if reason else ''}"
        case ev.SessionResumed(interrupted=interrupted):
            words = f"ended as held: {', '.join(interrupted)}" if interrupted else ""
        case ev.AuthorityChanged(refusal=refusal):
            words = f"nothing is sent from here: {refusal}" if refusal else "in command"
        case ev.CommandTaken():
            words = command_taken_in_words(data)
        case _:
            pass
    return words


def _planning_event(data: ev.EventPayload) -> str:
    """Return the words of events of steps 1 to 6."""
    words = ""
    match data:
        case ev.QuestionAsked(question=question, choices=choices):
            words = f"{question} {' | '.join(choices)}".strip()
        case ev.OrderRead(text=text, references=references):
            words = f"{text} | {references_in_words(references)}"
        case ev.WorkflowMoved():
            step = data.phases[data.phase] if 0 <= data.phase < len(data.phases) else data.outcome
            words = f"{data.track}: {step}"
        case ev.RulesRetrieved(hits=hits):
            words = ", ".join(hit.rule_id for hit in hits)
        case ev.PlanProposed(plan=plan, error=error):
            words = _plan(plan) if plan is not None else error
        case ev.PlanChecked(findings=findings, unmet=unmet):
            broken = [finding.rule_id for finding in findings if finding.broken]
            words = f"broken: {', '.join(broken)}" if broken else "no rule broken"
            words += "".join(f"; not met: {text}" for text in unmet)
        case (
            ev.PlanJudged(verdict=verdict, error=error)
            | ev.OutcomeJudged(verdict=verdict, error=error)
        ):
            words = f"{verdict.verdict}: {verdict.feedback}" if verdict is not None else error
        case ev.OrderReadAgain(model=model, asked=asked, error=error):
            words = f"{model}: {error or plain_reading(asked)}"
        case ev.RepairRequested(reasons=reasons):
            words = "; ".join(reasons)
        case ev.ApprovalRequested(blocked_by=blocked, plan=plan, readings=readings):
            words = _state(data) + ("; ".join(blocked) if blocked else _plan(plan))
            words += f" | if halted: {safety_in_words(data.if_halted)}" if data.if_halted else ""
            words += "".join(f" | or: {plain_reading(asked)}" for asked in readings)
        case ev.DecisionMade(decision=decision, accepted=accepted, detail=detail):
            words = f"{decision.kind} by {decision.by} {decision.reason}".strip()
            if deviations := deviations_in_words(decision):
                words = f"{decision.kind}: {deviations}"
            words += "" if accepted else f", not accepted: {detail}"
        case _:
            pass
    return words


def _state(request: ev.ApprovalRequested) -> str:
    """Return the state of a request in words; empty for one that can be plainly approved."""
    if request.state == "not_understood":
        return ""  # its one reason says so
    if request.blocked_by:
        return "blocked: "
    if request.state in (None, "approve"):
        return ""
    return f"{status_of('approval', request.state).word.lower()}: "


def _execution_event(data: ev.EventPayload) -> str:
    """Return the words of events of steps 7 and 8."""
    match data:
        case ev.CommandSent(command=command):
            return f"{command.agent}: {order_in_words(command)}"
        case ev.CommandRefused(command=command, reason=reason):
            return f"{command.agent}: {order_in_words(command)}: {reason}"
        case ev.PlanHalted(reasons=reasons):
            return "; ".join(reasons)
        case ev.MissionReported(text=text):
            return " ".join(text.split())
        case ev.StopUnconfirmed(assets=assets):
            return unconfirmed_in_words(assets)
        case _:
            return ""


def contact_in_words(contact: ev.ReportedContact) -> str:
    """Return the claims about a contact: *“ALPHA-1”, said to be a friend, vehicle, at (12, -3)*."""
    x, y = contact.at
    claimed = f"said to be {contact.affiliation}, {contact.what}"
    return f"“{contact.name}”, {claimed}, at ({x:.0f}, {y:.0f})"


def unconfirmed_in_words(assets: Mapping[str, str]) -> str:
    """Return which assets are not known to stand after a stop, and why."""
    if not assets:
        return "every asset stands, as telemetry shows"
    each = ", ".join(f"{name} ({why})" for name, why in assets.items())
    return f"STOP not confirmed by {each}"


def command_taken_in_words(taken: ev.CommandTaken) -> str:
    """Return the station that lost command, and the last record of its log."""
    return (
        f"taken from {taken.station} by {taken.by}, epoch {taken.epoch}; its session "
        f"{taken.session} had come to record {taken.records}, hash {taken.head[:12]}"
    )


def _plan(plan: Plan) -> str:
    return "; ".join(f"{action.agent} {action.command}" for action in plan.actions) or "no action"
