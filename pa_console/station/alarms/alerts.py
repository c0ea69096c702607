"""Alerts to people who are not at the screen: rules for messages, and a thread that sends them.

An alarm is sent once when it is raised. If an alarm or a plan waits too long, a reminder is sent to
more people. The station only passes on its events and never waits for a delivery.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Protocol, Self

from pa_console.schema.base import ALARM_PRIORITIES, AlarmPriority
from pa_console.schema.events import event as ev
from pa_console.schema.text import visible_line
from pa_console.session.state import SessionState
from pa_console.station.alarms.waits import Wait, is_answered, what_waits

AGAIN_S = 600.0
"""The time for which an alarm that clears and returns is not sent again, in seconds."""
MOST_SENT, SENT_WITHIN_S = 10, 600.0
"""The largest number of messages in a period, and the length of the period in seconds. Emergencies
are exempt; other items wait for the next message."""
MOST_LINES = 8
"""The largest number of lines in a message; further lines are only counted."""


@dataclass(frozen=True)
class Message:
    """A message; if `later`, it is sent to the addresses for reminders as well."""

    title: str
    body: str
    priority: AlarmPriority | None
    later: bool = False


@dataclass
class _Waiting:
    """An item that waits, with its start, the number of reminders, and the time of the next one."""

    wait: Wait
    since_s: float
    next_s: float
    times: int = 0


class AlertRules:
    """The rules for messages; times are in seconds of any clock that only goes forward."""

    def __init__(self, lowest: AlarmPriority, after_s: float) -> None:
        """Send alarms of priority `lowest` or higher, and reminders after `after_s` if not 0."""
        self._told_of = ALARM_PRIORITIES[: ALARM_PRIORITIES.index(lowest) + 1]
        self._after_s = after_s
        self._state = SessionState()
        self._waits: dict[str, _Waiting] = {}
        self._sent_at: dict[str, float] = {}
        self._pending: list[tuple[Wait, str]] = []
        self._late: list[tuple[Wait, str]] = []
        self._sent: deque[float] = deque(maxlen=MOST_SENT)

    def take(self, event: ev.Event, now_s: float) -> None:
        """Process one event of the session."""
        state = self._state
        state.apply(event)
        if isinstance(event.data, ev.MissionFinished):
            needed = {state.active, state.last_active, state.latest, *state.answers.values()}
            for name, trace in list(state.missions.items()):
                if trace.status is not None and name not in needed:
                    del state.missions[name]
        if isinstance(event.data, ev.TelemetryReceived):
            return
        now = {} if state.ended else what_waits(state, self._told_of)
        answered = {
            f"alarm {item.alarm.id} {item.alarm.priority}"
            for item in state.alarms
            if is_answered(state, item)
        }
        for key in self._waits.keys() - (now.keys() - answered):
            del self._waits[key]
        for key, wait in now.items():
            if key not in self._waits and key not in answered:
                self._waits[key] = _Waiting(wait, now_s, now_s + self._after_s)
                if (
                    wait.priority is not None
                    and now_s - self._sent_at.get(key, -AGAIN_S) >= AGAIN_S
                ):
                    self._sent_at[key] = now_s
                    self._pending.append((wait, ""))

    def due(self, now_s: float) -> list[Message]:
        """Return the messages that are due: at most one for new items, and one for reminders."""
        self._sent_at = {key: at for key, at in self._sent_at.items() if now_s - at < AGAIN_S}
        for waiting in self._waits.values():
            if self._after_s and now_s >= waiting.next_s:
                waited_s = now_s - waiting.since_s
                waiting.times += 1
                waiting.next_s = now_s + self._after_s * 2**waiting.times
                self._late.append((waiting.wait, f", for {math.ceil(waited_s / 60)} min"))
        return [
            *self._message(self._pending, now_s, later=False),
            *self._message(self._late, now_s, later=True),
        ]

    def next_s(self, now_s: float) -> float:
        """Return the seconds until a message may be due if no other event is received."""
        at = [waiting.next_s for waiting in self._waits.values()] if self._after_s else []
        if self._pending or self._late:
            at.append(self._sent[0] + SENT_WITHIN_S if self._sent else now_s)
        return max(0.0, min(at, default=now_s + SENT_WITHIN_S) - now_s)

    def _message(
        self, about: list[tuple[Wait, str]], now_s: float, *, later: bool
    ) -> Sequence[Message]:
        """Return one message about all items in `about`; none if too many messages were sent."""
        if not about:
            return ()
        worst = min(about, key=lambda item: _rank(item[0].priority))[0]
        full = len(self._sent) == MOST_SENT and now_s - self._sent[0] < SENT_WITHIN_S
        if full and worst.priority != "emergency":
            return ()
        self._sent.append(now_s)
        lines = [f"{wait.text}{since}. {wait.detail}".strip() for wait, since in about]
        more = len(lines) - MOST_LINES
        lines = [*lines[:MOST_LINES], *([f"and {more} more"] if more > 0 else [])]
        about.clear()
        title = f"PA Console: {'NOBODY ACTS, ' if later else ''}{worst.text}"
        body = "\n".join(visible_line(line) for line in lines)
        return (Message(visible_line(title), body, worst.priority, later),)


def _rank(priority: AlarmPriority | None) -> int:
    return len(ALARM_PRIORITIES) if priority is None else ALARM_PRIORITIES.index(priority)


class Delivery(Protocol):
    """A sender of messages to people."""

    def give(self, message: Message) -> None:
        """Start the delivery of a message, and return at once."""
        ...

    def news(self) -> Sequence[str]:
        """Return the results of deliveries since the last call, one line each."""
        ...


class Alerting:
    """A context manager that sends alerts about a session; `take` receives the session's events."""

    def __init__(
        self, rules: AlertRules, delivery: Delivery, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._rules, self._delivery, self._clock = rules, delivery, clock
        self._events: SimpleQueue[ev.Event | None] = SimpleQueue()
        self._thread = Thread(target=self._run, name="alerts", daemon=True)
        self._problem: list[str] = []

    def take(self, event: ev.Event) -> None:
        """Pass an event to the thread, and return at once."""
        self._events.put(event)

    def news(self) -> Sequence[ev.OutsideReport]:
        """Return notices about messages that were sent or could not be sent."""
        return [
            ev.Noticed(
                level="warning" if "not told" in line else "info", subject="alert", text=line
            )
            for line in [*self._delivery.news(), *self._problems()]
        ]

    def _problems(self) -> list[str]:
        problems, self._problem = self._problem, []
        return problems

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._events.put(None)
        self._thread.join(1.0)

    def _run(self) -> None:
        try:
            self._watch()
        except Exception as error:  # a failure must neither end the session nor go unnoticed
            self._problem = [f"people are not told any more: {type(error).__name__}: {error}"]

    def _watch(self) -> None:
        while True:
            try:
                event = self._events.get(timeout=self._rules.next_s(self._clock()) + 0.01)
            except Empty:
                pass
            else:
                if event is None:
                    return
                self._rules.take(event, self._clock())
            for message in self._rules.due(self._clock()):
                self._delivery.give(message)
