"""Folds the event stream into the state that every view shows; live and replay use the same."""

from collections import deque
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass, field
from datetime import datetime

from pa_console.schema.alarm import ALARM_PRIORITIES, Alarm, QueueEntry
from pa_console.schema.events import event as ev
from pa_console.schema.telemetry import Picture
from pa_console.session.state.mission_trace import (
    CommandTrace,
    MissionTrace,
    apply_to_mission,
    withhold_approval,
)
from pa_console.session.state.standing_trace import StandingTrace, apply_to_standing
from pa_console.session.state.tak_trace import TakTrace
from pa_console.session.wording import (
    alarm_now,
    answer_in_words,
    command_taken_in_words,
    in_words,
    order_in_words,
    overriding,
)

NOTICES_KEPT = 500
_LEVELS: dict[str, ev.Level] = {"emergency": "alarm", "high": "alarm", "medium": "warning"}


@dataclass(frozen=True)
class Notice:
    """One line of the event list; one that is `hidden` no operator could know of at the time."""

    t: datetime
    tick: int
    level: ev.Level
    subject: str
    text: str
    hidden: bool = False


@dataclass(frozen=True)
class OpenAlarm:
    """An alarm whose cause is still there; `acknowledged_by` is empty until somebody saw it."""

    alarm: Alarm
    acknowledged_by: str = ""

    @property
    def acknowledged(self) -> bool:
        """Whether somebody has seen it."""
        return bool(self.acknowledged_by)


@dataclass
class Stop:
    """The operator's stop until it is released, and the latest order of each asset since then."""

    by: str
    tick: int
    orders: dict[str, CommandTrace] = field(default_factory=dict[str, CommandTrace])

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """The assets that were told to hold and have not said that they do."""
        return tuple(name for name, sent in self.orders.items() if not _is_done(sent))

    @property
    def held(self) -> int:
        """How many assets have said that they hold."""
        return len(self.orders) - len(self.unconfirmed)


@dataclass
class SessionState:
    """The whole session as it stands after the last applied event.

    `latest` is the mission that arrived last, `last_active` the one that was worked on last, and
    `answers` the unfinished mission that answers an alarm, by the alarm's id. `loose_orders` are
    those of no mission since the last stop. `log_problem` is why the log cannot be written,
    `relieved` why its station may move nothing where its site has keys.
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
    standing: dict[str, StandingTrace] = field(default_factory=dict[str, StandingTrace])
    """The standing orders that were approved, by their ids, the oldest first."""
    tak: TakTrace = field(default_factory=TakTrace)

    @property
    def reported_contacts(self) -> Mapping[str, ev.ReportedContact]:
        """What others on the TAK server say is around, by uid; our sensors have not seen it."""
        return self.tak.contacts

    @property
    def current(self) -> MissionTrace | None:
        """The mission being worked on, else the last one that was, else the latest to arrive."""
        chosen = self.active or self.last_active or self.latest
        return self.missions[chosen] if chosen is not None else None

    @property
    def scenario(self) -> str:
        """The name of the scenario that is played, empty without one."""
        return self.started.scenario if self.started else ""

    @property
    def alarms(self) -> tuple[OpenAlarm, ...]:
        """The open alarms: worst priority first, then the nearest, then the oldest.

        What an alarm says of a track is what the picture shows of it now.
        """
        now = (
            OpenAlarm(alarm_now(item.alarm, self.picture), item.acknowledged_by)
            for item in self.open_alarms.values()
        )
        return tuple(sorted(now, key=_urgency))

    def is_worse(self, alarm: Alarm) -> bool:
        """Whether `alarm` is new, or of a worse priority than it was."""
        known = self.open_alarms.get(alarm.id)
        return known is None or _rank(alarm) < _rank(known.alarm)

    def is_news(self, alarm: Alarm) -> bool:
        """Whether `alarm` is new, of a worse priority, or of another kind than it was."""
        known = self.open_alarms.get(alarm.id)
        return self.is_worse(alarm) or (known is not None and known.alarm.kind != alarm.kind)

    def apply(self, event: ev.Event) -> None:
        """Take one event in; an event of an unknown mission changes no mission."""
        self.tick = max(self.tick, event.tick)
        self._apply_to_session(event)
        self._apply_to_command(event)
        self._apply_to_alarms(event)
        self._apply_to_queue(event)
        self._apply_to_standing(event)
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
                self._notice(event, "warning", subject, in_words(incident), hidden=hidden)
            case ev.CommandRefused(command=command, reason=reason):
                self._notice(event, "alarm", command.agent, f"{order_in_words(command)}: {reason}")
            case ev.LogTroubled(problem=problem):
                self.log_problem = problem
                text = f"nothing is dispatched: {problem}" if problem else "written again"
                self._notice(event, "alarm" if problem else "info", "session log", text)
            case ev.QuestionAnswered(question=question):
                asked = f"asked “{question}”; its trace has the answer"
                text = asked if event.mission else answer_in_words(event.data)
                self._notice(event, "info", event.mission or "question", text)
            case ev.SessionEnded(reason=reason):
                self.ended = reason
            case ev.SessionResumed():
                self.ended, self.relieved, self.worker, self.servers = "", "", None, {}
                text = "goes on after its console ended without closing it"
                self._notice(event, "warning", "session", text)
            case _:
                pass

    def _apply_to_command(self, event: ev.Event) -> None:
        """Who has command of the team, and whether all of it is stopped."""
        match event.data:
            case ev.AllStopped(by=by):
                orders = self.stop.orders if self.stop is not None else self.loose_orders
                self.stop = Stop(by, event.tick, orders)
                self.loose_orders = {}
                self._notice(event, "alarm", "stop", f"all assets hold, ordered by {by}")
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
                known, worse = self.open_alarms.get(alarm.id), self.is_worse(alarm)
                by = "" if known is None or worse else known.acknowledged_by
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
                origin = "by an alarm: " if mission.source == "alarm" else ""
                origin += f"by standing order {mission.standing}: " * bool(mission.standing)
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
            case ev.DecisionMade(accepted=True, decision=decision, attempt=number):
                if said := overriding(decision):
                    self._notice(event, "warning", event.mission or "", f"plan {number}: {said}")
                if decision.standing_order:
                    said = f"approved by standing order {decision.standing_order}, unasked"
                    self._notice(event, "warning", event.mission or "", f"plan {number}: {said}")
            case ev.OutcomeJudged(verdict=verdict, error=error):
                if verdict is None or verdict.verdict == "Failure":
                    said = error if verdict is None else f"{verdict.verdict}: {verdict.feedback}"
                    text = f"the judge on the outcome: {said}"
                    self._notice(event, "warning", event.mission or "", text)
            case ev.MissionFinished(status=status, reason=reason):
                self._leave(event)
                self._answered(event.mission)
                level = "info" if status == "verified" else "warning"
                self._notice(event, level, event.mission or "", f"{status}: {reason}")
            case _:
                pass

    def _apply_to_standing(self, event: ev.Event) -> None:
        apply_to_standing(self.standing, event)
        match event.data:
            case ev.StandingOrderApproved(order=order, by=by):
                text = f"in force, approved by {by}: {order.text}"
                self._notice(event, "warning", order.id, text)
            case ev.StandingOrderWithheld(order_id=name, reason=reason, subject=subject):
                what = f"nothing is started for {subject}" if subject else "nothing is started"
                self._notice(event, "warning", name, f"{what}: {reason}")
            case ev.StandingOrderRevoked(order_id=name) if name in self.standing:
                self._notice(event, "warning", name, self.standing[name].ended)
            case _:
                pass

    def _leave(self, event: ev.Event) -> None:
        """Note that the active mission is not worked on any more; a waiting one never was."""
        if event.mission == self.active:
            self.active = None

    def _answered(self, mission: str | None) -> None:
        """Note that a mission answers no alarm any more."""
        for alarm in [alarm for alarm, answer in self.answers.items() if answer == mission]:
            del self.answers[alarm]

    def _apply_to_orders(self, data: ev.EventPayload) -> None:
        """Orders that belong to no mission: those of a stop, told before or after the stop."""
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


def _is_done(sent: CommandTrace) -> bool:
    return bool(sent.replies) and sent.replies[-1].status == "done"


def _rank(alarm: Alarm) -> int:
    return ALARM_PRIORITIES.index(alarm.priority)


def _urgency(item: OpenAlarm) -> tuple[int, float, float, str]:
    alarm = item.alarm
    distance = float("inf") if alarm.distance_m is None else alarm.distance_m
    return _rank(alarm), distance, alarm.raised_s, alarm.id
