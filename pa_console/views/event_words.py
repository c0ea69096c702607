"""Every event as a short line, plans with steps in words, and the search of a recording."""

import json
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import cast

from pa_console.language.canonical.reading import listed, place_words, plain_reading
from pa_console.schema.command import COMMANDS
from pa_console.schema.events import event as ev
from pa_console.schema.incident import Incident, Reaction, RevealTrack, SpawnTrack
from pa_console.schema.mission import StandingOrder
from pa_console.schema.plan import Action, Plan
from pa_console.schema.text import clock_text, count
from pa_console.session.recording import Recording
from pa_console.session.wording import (
    answer_in_words,
    command_taken_in_words,
    contact_in_words,
    deviations_in_words,
    incident_in_words,
    order_in_words,
    unconfirmed_in_words,
)
from pa_console.views.status_words import status_of

_REACTIONS: dict[Reaction, str] = {
    "leave": "leaves when warned",
    "stop": "stops when warned",
    "go_on": "goes on when warned",
}

AROUND = 60
"""The number of characters of an event that are shown with a hit."""
MOST_AWAITED = 2
"""The maximum number of awaited actions that are named; more are only counted."""


def incident_truth_in_words(incident: Incident) -> str:
    """Return `incident` in full, with a track's true properties, for a reader of the script."""
    match incident:
        case SpawnTrack(name=name, track=track, gate=gate):
            subject = f"a {track}{f' ({name})' if name else ''} appears on the lane to {gate}"
        case RevealTrack(track=track):
            subject = f"{track} from now on"
        case _:
            return incident_in_words(incident)
    truth = [trait for trait in (incident.identity, incident.intent) if trait]
    truth += [_REACTIONS[incident.when_warned]] if incident.when_warned else []
    return f"{subject}: {', '.join(truth)}" if truth else subject


def safety_in_words(declared: Sequence[Action]) -> str:
    """Return a plan's way to safety in words: the assets that go back, and those that hold."""
    back: dict[str, list[str]] = {}
    for action in declared:
        frames = back.setdefault(action.agent, []) if action.target is not None else []
        if action.target is not None and action.target not in frames:
            frames.append(action.target)
    parts = [
        f"{agent} back to {' or '.join(places)} (holds if another asset covers that gate by then)"
        for agent, places in back.items()
    ]
    holding = [*dict.fromkeys(a.agent for a in declared if a.agent not in back)]
    if holding:
        parts.append(f"{', '.join(holding)} {'hold' if len(holding) > 1 else 'holds'}")
    return "; ".join(parts)


def references_in_words(references: Sequence[ev.Reference]) -> str:
    """Return the references of an order with their meanings: *"it" = Drone_T04*."""
    return "; ".join(f"“{reference.said}” = {reference.means}" for reference in references)


def standing_in_words(order: StandingOrder) -> str:
    """Return a standing order in plain words, on one line."""
    return f"{order.id}: {trigger_in_words(order)}: {order.order_in_words}"


def trigger_in_words(order: StandingOrder) -> str:
    """Return the trigger of a standing order: a state, or moments of the clock."""
    return f"whenever {order.words}" if order.condition else order.words


def moments_in_words(moments: Sequence[datetime]) -> str:
    """Return moments of the station's clock with their zone, and the weekday if the day changes."""
    parts = list[str]()
    for before, at in zip((None, *moments), moments, strict=False):
        same = before is None or before.date() == at.date()
        parts.append(f"{at:%H:%M:%S}" if same else f"{at:%a %H:%M:%S}")
    return f"{', '.join(parts)} {moments[0]:%Z}".strip() if moments else "none"


def next_in_words(scheduled: ev.StandingOrderScheduled | None, now_s: float) -> str:
    """Return the next moment of an order and the time until then; '' if it has no moments."""
    if scheduled is None:
        return ""
    paused = "paused, " * scheduled.paused
    if scheduled.moment is None or scheduled.at_s is None:
        return paused.rstrip(", ")
    left = clock_text(max(scheduled.at_s - now_s, 0.0))
    return f"{paused}{scheduled.moment:%H:%M:%S} in {left}"


def asked_in_words(order: StandingOrder, allowed: Collection[str] | None = None) -> str:
    """Return the approval that missions started by `order` need.

    `allowed` are the commands that the rules let the order start without approval; None if they
    are unknown.
    """
    if not order.unasked:
        return "each mission waits for your approval"
    if allowed is None:
        return "not needed where the rules allow a start without it; otherwise you are asked"
    if not allowed:
        return "you are asked each time: the rules allow no exception"
    return f"not needed if a plan has only {', '.join(allowed)}; otherwise you are asked"


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
    "plan_voided": "{reason}",
    "command_replied": "{reply.agent}: {reply.status} {reply.detail}",
    "command_resent": "{command_id}, {times} times",
    "mission_verified": "{verification.outcome} {verification.reason}",
    "mission_finished": "{status}: {reason}",
    "all_stopped": "by {by}",
    "stop_released": "by {by}",
    "camera_still": "{track} by {camera} {problem}",
    "manual_control_taken": "{asset} by {by}",
    "manual_control_ended": "{asset} given back by {by}",
    "session_ended": "{reason}",
    "tak": "{detail}",
    "contact_lost": "{uid}: {reason}",
    "contacts_left_out": "{outside} off site, {too_many} over the limit, {unreadable} unreadable",
}


def event_in_words(data: ev.EventPayload) -> str:
    """Return the content of an event, without its kind; '' for a kind without content."""
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
        case ev.StandingOrderStarted(order_id=name, subject=subject, late_s=late_s):
            words = f"by {name}{f' for {subject}' if subject else ''}"
            words += f", {late_s:.0f} s late" if late_s else ""
        case ev.StandingOrderScheduled(order_id=name, change=change, by=by, moment=moment):
            words = f"{name}{f' {change} by {by}' if change else ''}, next "
            words += f"{moment:%H:%M:%S}" if moment is not None else "none"
        case ev.StandingOrderWithheld(order_id=name, subject=subject, reason=reason):
            words = f"{name}{f' for {subject}' if subject else ''}: {reason}"
        case ev.StandingOrderRevoked(order_id=name, by=by, reason=reason):
            words = f"{name} by {by}{f': {reason}' if reason else ''}"
        case ev.AgentMuted(agent=agent, muted=muted, by=by):
            words = f"{agent} {'muted' if muted else 'may propose again'}, by {by}"
        case ev.SessionResumed(interrupted=interrupted):
            missions = ", ".join(interrupted)
            words = f"missions interrupted, now ended as held: {missions}" if missions else ""
        case ev.AuthorityChanged(refusal=refusal):
            words = f"nothing is sent from here: {refusal}" if refusal else "in command"
        case ev.StepsPaused(paused=paused, by=by):
            words = f"{'paused' if paused else 'resumed'} by {by}"
        case ev.CommandTaken():
            words = command_taken_in_words(data)
        case _:
            pass
    return words


def _planning_event(data: ev.EventPayload) -> str:
    """Return the words of events of steps 1 to 7."""
    words = ""
    match data:
        case ev.QuestionAsked(question=question, choices=choices):
            words = f"{question} {' | '.join(choices)}".strip()
        case ev.OrderRead(text=text, references=references):
            words = f"{text} | {references_in_words(references)}"
        case ev.OrderStepRead(step=step, steps=steps, text=text):
            words = f"step {step} of {steps}: {text}"
        case ev.WorkflowMoved():
            step = data.phases[data.phase] if 0 <= data.phase < len(data.phases) else data.outcome
            words = f"{data.track}: {step}"
        case ev.RulesRetrieved(hits=hits):
            words = ", ".join(hit.rule_id for hit in hits)
        case ev.PlanProposed(plan=plan, error=error):
            words = orders_in_line(plan) if plan is not None else error
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
            words = _state(data) + ("; ".join(blocked) if blocked else orders_in_line(plan))
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
    """Return the state of a request in words; '' if nothing prevents a plain approval."""
    if request.state == "not_understood":
        return ""  # its only reason repeats the state
    if request.blocked_by:
        return "blocked: "
    if request.state in (None, "approve"):
        return ""
    return f"{status_of('approval', request.state).word.lower()}: "


def _execution_event(data: ev.EventPayload) -> str:
    """Return the words of events of steps 8 to 10."""
    match data:
        case ev.CommandSent(command=command):
            return f"{command.agent}: {order_in_words(command)}"
        case ev.CommandRefused(command=command, reason=reason):
            return f"{command.agent}: {order_in_words(command)}: {reason}"
        case ev.PlanHalted(reasons=reasons):
            return "; ".join(reasons)
        case ev.StepsHeld(orders=orders, reason=reason):
            return f"not sent: {'; '.join(orders)}: {reason}"
        case ev.MissionReported(text=text):
            return " ".join(text.split())
        case ev.StopUnconfirmed(assets=assets):
            return unconfirmed_in_words(assets)
        case ev.MissionAwaitsAssets(assets=assets, again=again):
            return f"{', '.join(assets)}{f' back, order queued again as {again}' if again else ''}"
        case _:
            return ""


_REWORDED = tuple(f'"{kind}"' for kind in ("decision_made", "incident", "plan_checked"))
"""The kinds of events for which lists show words that are not in the log."""


@dataclass(frozen=True)
class Hit:
    """An event that contains all the words; `excerpt` is the text around the first word."""

    index: int
    mission: str
    kind: str
    excerpt: str


def search(recording: Recording, text: str, first: int, end: int) -> Iterator[Hit]:
    """Yield the events from `first` up to `end` that contain every word of `text`, in any case.

    Telemetry is left out. Raises LogError if the log can no longer be read.
    """
    words = text.lower().split()
    needles = [json.dumps(word, ensure_ascii=False)[1:-1] for word in words]
    if not words:
        return
    for index in recording.timeline.without_telemetry(first, end):
        line = recording.content(index)
        lowered = line.lower()
        reworded = any(kind in line for kind in _REWORDED)
        # The text of the line is searched first, so that most events are excluded without parsing.
        if reworded or all(needle in lowered for needle in needles):
            fields = json.loads(line)
            texts = [fields["kind"], fields["mission"] or "", *_texts(fields["data"])]
            if reworded:
                texts.append(event_in_words(recording[index].data))
            if all(any(word in part.lower() for part in texts) for word in words):
                yield Hit(index, texts[1], texts[0], _excerpt(texts, words[0]))


def _texts(value: object) -> Iterator[str]:
    """Yield every text in a JSON value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for part in cast(dict[str, object], value).values():
            yield from _texts(part)
    elif isinstance(value, list):
        for part in cast(list[object], value):
            yield from _texts(part)


def _excerpt(texts: list[str], word: str) -> str:
    """Return the characters around `word` in the longest text that contains it."""
    text = max((part for part in texts if word in part.lower()), key=len)
    flat = " ".join(text.split())
    at = max(flat.lower().find(word), 0)
    first = max(at - AROUND // 3, 0)
    return ("…" if first else "") + flat[first : first + AROUND]


@dataclass(frozen=True)
class StepLine:
    """One line of a plan with steps: an action, or successive legs of one asset."""

    numbers: str
    """The step or steps: `1`, or `2 to 7`."""
    agent: str
    does: str
    when: str
    """The condition for its start, in words; '' for the first step."""

    @property
    def in_words(self) -> str:
        """The whole line: *2: Drone_T02 returns to base, then, after Robot_T01 is at Base*."""
        return f"{self.numbers}: {self.agent} {self.does}{f', {self.when}' if self.when else ''}"


def in_steps(plan: Plan) -> bool:
    """Return True if some actions of `plan` wait for others."""
    return len(plan.steps) > 1


def when_in_words(plan: Plan, number: int) -> str:
    """Return the condition of action `number`, from 1, e.g. *then, after D is at North Gate*.

    The result is '' for an action without a condition.
    """
    awaited = [plan.actions[other - 1] for other in plan.actions[number - 1].after]
    if not awaited:
        return ""
    if len(awaited) > MOST_AWAITED:
        return f"then, after {count(len(awaited), 'other action')}"
    return f"then, after {listed([_done(action) for action in awaited])}"


def step_lines(plan: Plan) -> tuple[StepLine, ...]:
    """Return the lines of a plan with steps; successive legs of one asset are one line."""
    lines: list[StepLine] = []
    leg: Action | None = None
    for position, numbers in enumerate(plan.steps, start=1):
        actions = [plan.actions[number - 1] for number in numbers]
        alone = actions[0] if len(actions) == 1 and actions[0].target is not None else None
        if alone is not None and leg is not None and _goes_on(leg, alone):
            first = lines[-1].numbers.partition(" to ")[0]
            does = f"{lines[-1].does} → {place_words(alone.target or '')}"
            lines[-1] = replace(lines[-1], numbers=f"{first} to {position}", does=does)
        else:
            lines += [
                StepLine(str(position), action.agent, _does(action), when_in_words(plan, number))
                for number, action in zip(numbers, actions, strict=True)
            ]
        leg = alone
    return tuple(lines)


def orders_in_line(plan: Plan) -> str:
    """Return a plan's actions on one line, with *then* before each group that waits."""
    parts = [
        "; ".join(f"{plan.actions[n - 1].agent} {plan.actions[n - 1].command}" for n in numbers)
        for numbers in plan.steps
    ]
    return "; then ".join(filter(None, parts)) or "no action"


def _goes_on(leg: Action, following: Action) -> bool:
    same = (leg.agent, leg.verb, leg.stay_s) == (following.agent, following.verb, following.stay_s)
    return same and len(following.after) == 1


def _does(action: Action) -> str:
    place = place_words(action.target) if action.target else ""
    plainly = COMMANDS[action.verb].plainly
    stays = f" ({action.stay_s:g} s at each place)" if action.stay_s else ""
    match action.verb:
        case "move_to":
            return f"goes{stays}: {place}"
        case "return_to_base":
            return "returns to base"
        case "hold":
            return "holds"
        case _:
            return f"{plainly}{stays}: {place}" if place else plainly


def _done(action: Action) -> str:
    """Return the words for the completion of an action."""
    place = place_words(action.target) if action.target else ""
    match action.verb:
        case "return_to_base":
            return f"{action.agent} is at the base"
        case "hold":
            return f"{action.agent} holds"
        case "report":
            return f"{action.agent} has reported"
        case "identify":
            return f"{action.agent} has identified the track at {place}"
        case "warn":
            return f"{action.agent} has warned the track at {place}"
        case _:
            return f"{action.agent} is at {place}"
