"""The state of a session, folded from its events; it is the same live and in a replay."""

from collections import deque
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass, field

from pa_console.schema.base import ALARM_PRIORITIES
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Alarm, QueueEntry
from pa_console.schema.telemetry import Picture
from pa_console.session.mission_fold import apply_to_mission, withhold_approval
from pa_console.session.mission_trace import CommandTrace, MissionTrace
from pa_console.session.state_parts import (
    ManualTrace,
    Notice,
    OpenAlarm,
    StandingTrace,
    StartTrace,
    Stop,
    TakTrace,
)
from pa_console.session.wording import (
    alarm_now,
    answer_in_words,
    command_taken_in_words,
    deviations_in_words,
    incident_in_words,
    order_in_words,
    unconfirmed_in_words,
)

NOTICES_KEPT = 500
STILLS_KEPT = 50
_LEVELS: dict[str, ev.Level] = {"emergency": "alarm", "high": "alarm", "medium": "warning"}

BY_CLOCK = "the clock"
"""The value of `by` in the event that ends a timed order after its last moment."""
MOST_STARTS_KEPT = 100


@dataclass
class SessionState:
    """The whole session after the last applied event.

    `latest` is the mission that arrived last, and `last_active` the last mission in progress.
    `answers` maps an alarm's id to the unfinished mission that answers the alarm. `loose_orders`
    are commands after the last stop that belong to no mission. `log_problem` is the reason why the
    log cannot be written. `relieved` is the reason why a station of a site with keys may not move
    any asset.
    """

    started: ev.SessionStarted | None = None
    ended: str = ""
    log_problem: str = ""
    relieved: str = ""
    tick: int = 0
    picture: Picture | None = None
    worker: ev.WorkerChanged | None = None
    servers: dict[str, ev.ServerChanged] = field(default_factory=dict[str, ev.ServerChanged])
    missions: MutableMapping[str, MissionTrace] = field(default_factory=dict[str, MissionTrace])
    active: str | None = None
    last_active: str | None = None
    latest: str | None = None
    queue: tuple[QueueEntry, ...] = ()
    stop: Stop | None = None
    notices: deque[Notice] = field(default_factory=lambda: deque(maxlen=NOTICES_KEPT))
    open_alarms: dict[str, OpenAlarm] = field(default_factory=dict[str, OpenAlarm])
    answers: dict[str, str] = field(default_factory=dict[str, str])
    loose_orders: dict[str, CommandTrace] = field(default_factory=dict[str, CommandTrace])
    last_agent: str = ""
    """The last agent that proposed a mission."""
    muted_agents: frozenset[str] = frozenset()
    """The agents that may not propose missions."""
    standing: dict[str, StandingTrace] = field(default_factory=dict[str, StandingTrace])
    """The approved standing orders by id, oldest first."""
    manual: dict[str, ManualTrace] = field(default_factory=dict[str, ManualTrace])
    """The assets whose manual control was taken at this station, in the order of taking."""
    awaiting: dict[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """The missions that await assets under manual control, each with these assets."""
    tak: TakTrace = field(default_factory=TakTrace)
    stills: dict[str, ev.CameraStill] = field(default_factory=dict[str, ev.CameraStill])
    """The latest still of each track that was shown recently."""

    @property
    def time_s(self) -> float:
        """The time of the picture on the fleet's clock; 0 before the first picture."""
        return self.picture.time_s if self.picture is not None else 0.0

    @property
    def reported_contacts(self) -> Mapping[str, ev.ReportedContact]:
        """The contacts that the TAK server reports, by uid; no sensor has detected them."""
        return self.tak.contacts

    @property
    def current(self) -> MissionTrace | None:
        """The active mission, else the last active one, else the latest to arrive."""
        chosen = self.active or self.last_active or self.latest
        return self.missions[chosen] if chosen is not None else None

    @property
    def scenario(self) -> str:
        """The name of the running scenario; '' without one."""
        return self.started.scenario if self.started else ""

    @property
    def alarms(self) -> tuple[OpenAlarm, ...]:
        """The open alarms: those of the highest priority first, then the nearest, then the oldest.

        In an alarm's text, place and distance of a track are taken from the present picture.
        """
        now = (
            OpenAlarm(alarm_now(item.alarm, self.picture), item.acknowledged_by)
            for item in self.open_alarms.values()
        )
        return tuple(sorted(now, key=_urgency))

    def is_worse(self, alarm: Alarm) -> bool:
        """Return True if `alarm` is new, or has a higher priority than before."""
        before = self.open_alarms.get(alarm.id)
        return before is None or _rank(alarm) < _rank(before.alarm)

    def is_news(self, alarm: Alarm) -> bool:
        """Return True if `alarm` is new, or has a higher priority or another kind than before."""
        before = self.open_alarms.get(alarm.id)
        return self.is_worse(alarm) or (before is not None and before.alarm.kind != alarm.kind)

    def apply(self, event: ev.Event) -> None:
        """Apply one event; an event of an unknown mission changes no mission."""
        self.tick = max(self.tick, event.tick)
        self._apply_to_session(event)
        self._apply_to_command(event)
        self._apply_to_alarms(event)
        self._apply_to_queue(event)
        self._apply_to_standing(event)
        self._apply_to_manual(event)
        for level, text in self.tak.apply(event):
            self._notice(event, level, "TAK", text)
        trace = self.missions.get(event.mission) if event.mission else None
        if trace is not None:
            apply_to_mission(trace, event.data)
        else:
            self._apply_to_orders(event.data)

    def _apply_to_session(self, event: ev.Event) -> None:
        match event.data:
            case ev.SessionStarted():
                self.started = event.data
            case ev.RulesReplaced() if self.started is not None:
                names = ("rules", "rules_sha256", "rules_seal")
                changed = {name: getattr(event.data, name) for name in names}
                self.started = self.started.model_copy(update=changed)
            case ev.TelemetryReceived(picture=picture):
                self.picture = picture
            case ev.WorkerChanged(state=state, detail=detail):
                self.worker = event.data
                level = "info" if state in ("loading", "ready", "slow") else "warning"
                self._notice(event, level, "model", f"{state} {detail}".strip())
            case ev.ServerChanged(server=server, state=state, detail=detail):
                self.servers[server] = event.data
                level = "info" if state in ("probing", "ready") else "warning"
                self._notice(event, level, "model server", f"{server} {state}: {detail}")
            case ev.Noticed(level=level, subject=subject, text=text):
                self._notice(event, level, subject, text)
            case ev.IncidentHappened(incident=incident, source=source):
                subject = "what-if" if source == "operator" else "scenario"
                hidden = source == "scenario"
                self._notice(event, "warning", subject, incident_in_words(incident), hidden=hidden)
            case ev.CommandRefused(command=command, reason=reason):
                self._notice(event, "alarm", command.agent, f"{order_in_words(command)}: {reason}")
            case ev.LogTroubled(problem=problem):
                self.log_problem = problem
                text = f"nothing is dispatched: {problem}" if problem else "written again"
                self._notice(event, "alarm" if problem else "info", "session log", text)
            case ev.QuestionAnswered(question=question):
                pointer = f"asked “{question}”; the mission's trace has the answer"
                text = pointer if event.mission else answer_in_words(event.data)
                self._notice(event, "info", event.mission or "question", text)
            case ev.CameraStill(track=track, camera=camera, problem=problem):
                before = self.stills.pop(track, None)
                self.stills[track] = event.data
                for name in list(self.stills)[:-STILLS_KEPT]:
                    del self.stills[name]
                if problem and (before is None or before.problem != problem):
                    self._notice(event, "warning", camera, f"no still of {track}: {problem}")
            case ev.SessionEnded(reason=reason):
                self.ended = reason
            case ev.SessionResumed():
                self.ended, self.relieved, self.worker, self.servers = "", "", None, {}
                text = "continued after its console ended without closing it"
                self._notice(event, "warning", "session", text)
            case _:
                pass

    def _apply_to_command(self, event: ev.Event) -> None:
        """Apply a stop, or a change of the station in command."""
        match event.data:
            case ev.AllStopped(by=by):
                orders = self.stop.orders if self.stop is not None else self.loose_orders
                self.stop = Stop(by, event.tick, orders)
                self.loose_orders = {}
                self._notice(event, "alarm", "stop", f"all assets hold, ordered by {by}")
            case ev.StopUnconfirmed(assets=assets) if self.stop is not None:
                text = unconfirmed_in_words(assets)
                level = "alarm" if assets else "info"
                self.stop.overdue = dict(assets)
                self._notice(event, level, "stop", text)
            case ev.StopReleased(by=by):
                self.stop = None
                self._notice(event, "warning", "stop", f"released by {by}")
            case ev.AuthorityChanged(refusal=refusal):
                if self.active is not None and self.active in self.missions:
                    withhold_approval(self.missions[self.active], self.relieved, refusal)
                self.relieved = refusal
            case ev.CommandTaken():
                self._notice(event, "warning", "command", command_taken_in_words(event.data))
            case _:
                pass

    def _apply_to_alarms(self, event: ev.Event) -> None:
        match event.data:
            case ev.AlarmRaised(alarm=alarm):
                before, worse = self.open_alarms.get(alarm.id), self.is_worse(alarm)
                by = "" if before is None or worse else before.acknowledged_by
                self.open_alarms[alarm.id] = OpenAlarm(alarm, by)
                if worse:
                    level = _LEVELS.get(alarm.priority, "info")
                    self._notice(event, level, alarm.subject, alarm.text)
            case ev.AlarmAcknowledged(alarm_id=alarm_id, by=by) if alarm_id in self.open_alarms:
                alarm = self.open_alarms[alarm_id].alarm
                self.open_alarms[alarm_id] = OpenAlarm(alarm, by or "somebody")
                self._notice(event, "info", alarm.subject, f"alarm acknowledged by {by}")
            case ev.AlarmCleared(alarm_id=alarm_id, reason=reason) if alarm_id in self.open_alarms:
                alarm = self.open_alarms.pop(alarm_id).alarm
                self._notice(event, "info", alarm.subject, f"alarm over: {reason}")
            case _:
                pass

    def _apply_to_queue(self, event: ev.Event) -> None:
        match event.data:
            case ev.QueueChanged(entries=entries):
                self.queue = entries
            case ev.MissionReceived(mission=mission):
                self.missions[mission.id] = MissionTrace(mission)
                self.latest = mission.id
                if mission.alarm:
                    self.answers[mission.alarm] = mission.id
                self.last_agent = mission.agent or self.last_agent
                origin = f"{mission.origin}: " if mission.origin else ""
                self._notice(event, "info", mission.id, f"{origin}{mission.said}")
            case ev.MissionStarted() if event.mission in self.missions:
                self.active = self.last_active = event.mission
                self.stop = None
            case ev.MissionStarted():
                self.active = None
            case ev.MissionPreempted(by=by, reason=reason):
                self._leave(event)
                text = f"back to the queue, {by} goes first: {reason}"
                self._notice(event, "warning", event.mission or "", text)
            case ev.PlanHalted(reasons=reasons):
                self._notice(event, "alarm", event.mission or "", f"halted: {'; '.join(reasons)}")
            case ev.StepsPaused(paused=paused, by=by):
                text = f"paused by {by}: no further step is sent" if paused else f"resumed by {by}"
                self._notice(event, "warning", event.mission or "", text)
            case ev.StepsHeld(orders=orders, reason=reason):
                text = f"not sent: {'; '.join(orders)}: {reason}"
                self._notice(event, "alarm", event.mission or "", text)
            case ev.DecisionMade(accepted=True, decision=decision, attempt=number):
                if words := deviations_in_words(decision):
                    self._notice(event, "warning", event.mission or "", f"plan {number}: {words}")
                if decision.standing_order:
                    words = f"approved by standing order {decision.standing_order}, unasked"
                    self._notice(event, "warning", event.mission or "", f"plan {number}: {words}")
            case ev.OutcomeJudged(verdict=verdict, error=error):
                if verdict is None or verdict.verdict == "Failure":
                    words = error if verdict is None else f"{verdict.verdict}: {verdict.feedback}"
                    text = f"the judge on the outcome: {words}"
                    self._notice(event, "warning", event.mission or "", text)
            case ev.MissionFinished(status=status, reason=reason):
                self._leave(event)
                self._answered(event.mission)
                level = "info" if status == "verified" else "warning"
                trace = self.missions.get(event.mission or "")
                settled = trace is not None and trace.standing is not None and level == "info"
                summary = reason if settled else f"{status}: {reason}"
                self._notice(event, level, event.mission or "", summary)
            case _:
                pass

    def _apply_to_standing(self, event: ev.Event) -> None:
        orders = self.standing
        match event.data:
            case ev.StandingOrderApproved(order=order, by=by):
                orders[order.id] = StandingTrace(order, by, event.tick)
                text = f"in force, approved by {by}: {order.text}"
                self._notice(event, "warning", order.id, text)
            case ev.StandingOrderStarted(order_id=name, subject=subject) if name in orders:
                trace = orders[name]
                trace.starts.append(StartTrace(event.tick, subject, event.mission or ""))
                del trace.starts[:-MOST_STARTS_KEPT]
                trace.started += 1
            case ev.StandingOrderWithheld(order_id=name, reason=reason, subject=subject):
                if name in orders:
                    orders[name].withheld = event.data
                text = f"no mission is started{f' for {subject}' if subject else ''}"
                self._notice(event, "warning", name, f"{text}: {reason}")
            case ev.StandingOrderRevoked(order_id=name, by=by, reason=reason) if name in orders:
                revoked = f"revoked by {by}{f': {reason}' if reason else ''}"
                orders[name].ended = reason if by == BY_CLOCK else revoked
                self._notice(event, "warning", name, orders[name].ended)
            case ev.StandingOrderScheduled(order_id=name, by=by, change=change) if name in orders:
                orders[name].next = event.data
                if change:
                    self._notice(event, "warning", name, f"{change} by {by}")
            case ev.AgentMuted(agent=agent, muted=True, by=by):
                self.muted_agents |= {agent}
                self._notice(event, "warning", agent, f"muted by {by}: it may propose no missions")
            case ev.AgentMuted(agent=agent, by=by):
                self.muted_agents -= {agent}
                self._notice(event, "warning", agent, f"unmuted by {by}: it may propose missions")
            case ev.SessionEnded():
                for trace in orders.values():
                    trace.ended = trace.ended or "the session has ended"
            case _:
                pass

    def _apply_to_manual(self, event: ev.Event) -> None:
        match event.data:
            case ev.ManualControlTaken(asset=asset, by=by):
                self.manual[asset] = ManualTrace(by, event.tick)
                text = f"under manual control, taken by {by}: only a stop is sent to it"
                self._notice(event, "warning", asset, text)
            case ev.ManualControlEnded(asset=asset, by=by):
                self.manual.pop(asset, None)
                text = f"manual control ended by {by}: it accepts commands again"
                self._notice(event, "warning", asset, text)
            case ev.MissionAwaitsAssets(assets=assets, again="") if event.mission:
                self.awaiting[event.mission] = assets
                text = f"awaits {', '.join(assets)}, under manual control"
                self._notice(event, "warning", event.mission, text)
            case ev.MissionAwaitsAssets(assets=assets, again=again) if event.mission:
                self.awaiting.pop(event.mission, None)
                text = f"{', '.join(assets)} available again: queued as {again}"
                self._notice(event, "info", event.mission, text)
            case ev.AllStopped():
                for name, assets in self.awaiting.items():
                    text = f"no longer awaits {', '.join(assets)}: everything is stopped"
                    self._notice(event, "warning", name, text)
                self.awaiting = {}
            case _:
                pass

    def _leave(self, event: ev.Event) -> None:
        """Clear `active` if it is the event's mission."""
        if event.mission == self.active:
            self.active = None

    def _answered(self, mission: str | None) -> None:
        for alarm in [alarm for alarm, answer in self.answers.items() if answer == mission]:
            del self.answers[alarm]

    def _apply_to_orders(self, data: ev.EventPayload) -> None:
        """Apply commands without a mission: those of a stop, which may precede the stop's event."""
        orders = self.stop.orders if self.stop is not None else self.loose_orders
        match data:
            case ev.CommandSent(command=command):
                orders[command.agent] = CommandTrace(command)
            case ev.CommandReplied(reply=reply):
                sent = orders.get(reply.agent)
                if sent is not None and sent.command.command_id == reply.command_id:
                    sent.replies.append(reply)
            case ev.CommandResent(command_id=command_id, times=times):
                for sent in orders.values():
                    if sent.command.command_id == command_id:
                        sent.resent = times
            case _:
                pass

    def _notice(
        self, event: ev.Event, level: ev.Level, subject: str, text: str, *, hidden: bool = False
    ) -> None:
        self.notices.append(Notice(event.t, event.tick, level, subject, text, hidden))


def _rank(alarm: Alarm) -> int:
    return ALARM_PRIORITIES.index(alarm.priority)


def _urgency(item: OpenAlarm) -> tuple[int, float, float, str]:
    alarm = item.alarm
    distance = float("inf") if alarm.distance_m is None else alarm.distance_m
    return _rank(alarm), distance, alarm.raised_s, alarm.id


def waiting_entries(state: SessionState) -> tuple[QueueEntry, ...]:
    """Return the queue's entries for missions that have not begun, the next mission first."""
    missions = state.missions
    return tuple(
        entry
        for entry in state.queue
        if (trace := missions.get(entry.mission.id)) is None
        or not (_begun(state, trace) or trace.status is not None)
    )


def begun_missions(state: SessionState) -> tuple[MissionTrace, ...]:
    """Return the missions that have begun but not ended, in order of arrival."""
    return tuple(
        trace for trace in state.missions.values() if trace.status is None and _begun(state, trace)
    )


def _begun(state: SessionState, trace: MissionTrace) -> bool:
    """Return True if a mission is active or was active until an emergency preempted it."""
    return bool(trace.attempts) or trace.mission.id == state.active
