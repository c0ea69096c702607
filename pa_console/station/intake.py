"""The intake, which turns an operator's words and the site's alarms into queued missions."""

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import NamedTuple

from pa_console.language.questions import Question, read_question
from pa_console.language.references.scene import ReferenceScene
from pa_console.mission.orders.standing import Due
from pa_console.mission.spelling import read_words
from pa_console.policy.plain_text import compatible_form
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.mission import (
    MAX_MISSION_TEXT,
    Alarm,
    Mission,
    QueueEntry,
)
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.station.alarms.alarm_book import MOST_ALIKE, AlarmBook
from pa_console.station.mission_queue import MissionQueue

LEAST_LETTERS = 3
"""The least number of letters in an order; a shorter word is a key that was meant for a panel."""
IS_STOPPED = "everything is stopped: no mission is accepted until the stop is released"
MOST_FROM_ALARMS = 32
"""The largest number of missions from alarms that wait at a time.

They are hours of work for one operator. Further alarms get their missions when there is room, the
most urgent first. At most MOST_ALIKE of the missions are about contacts of the same sensors, so
that a sensor with false reports leaves room for other sensors.
"""


class ReadText(NamedTuple):
    """An operator's text as it was read: a mission, or a question about the record."""

    typed: str
    """The words as typed."""
    text: str
    """The words as shown, with corrected misspellings."""
    question: Question | None = None


def read_text(text: str, scene: ReferenceScene, rulebook: Rulebook) -> ReadText:
    """Read a text, which is a question or a mission, and correct its misspellings."""
    typed, shown = " ".join(text.split()), " ".join(compatible_form(text).split())
    if not shown or len(typed) > MAX_MISSION_TEXT:
        return ReadText(typed, shown)
    right = read_words(shown, scene.world, rulebook)
    question = read_question(scene, right)
    return ReadText(typed, right, question and replace(question, text=typed))


@dataclass
class Arrivals:
    """The results of a new picture: events to emit, and queued missions whose cause is gone."""

    payloads: list[tuple[ev.EventPayload, str | None]] = field(
        default_factory=list[tuple[ev.EventPayload, str | None]]
    )
    obsolete: list[Mission] = field(default_factory=list[Mission])


class Intake:
    """The alarms of the site and the queue of waiting missions.

    Methods return the events to emit; no simulator is needed.
    """

    def __init__(self, world: World, session: str, *, respond: bool) -> None:
        """Begin without alarms; if `respond`, alarms become missions."""
        self.alarms, self.queue = AlarmBook(world), MissionQueue()
        self._session, self._respond = session, respond
        self._count = 0
        self._emitted: tuple[tuple[str, str, bool], ...] = ()
        self._postponed: set[str] = set()
        """The ids of open alarms that get a mission when there is room."""

    def look(
        self, picture: Picture, handled: Collection[str], *, stopped: bool = False
    ) -> Arrivals:
        """Process a new picture: raise and clear alarms, and queue and drop their missions.

        An alarm about a subject in `handled` needs no mission, because the active mission deals
        with it. While everything is `stopped`, no alarm becomes a mission.
        """
        arrivals = Arrivals()
        for payload in self.alarms.look(picture):
            arrivals.payloads.append((payload, None))
            match payload:
                case ev.AlarmRaised(alarm=alarm) if not stopped:
                    arrivals.payloads += self._answers([alarm], handled)
                case ev.AlarmCleared(alarm_id=alarm_id):
                    arrivals.obsolete += self.queue.take(lambda mission: mission.alarm == alarm_id)
                case _:
                    pass
        alarms = self.alarms.open
        if not stopped:
            postponed, self._postponed = self._postponed, set()
            waiting = [alarm for alarm in alarms if alarm.id in postponed]
            arrivals.payloads += self._answers(waiting, handled)
        self.queue.refresh(alarms)
        return arrivals

    def resume(self, handled: Collection[str]) -> list[tuple[ev.EventPayload, str]]:
        """Queue a mission for every open alarm without a mission, after a stop was released."""
        return self._answers(self.alarms.open, handled)

    def take_up(
        self, alarms: AlarmBook, entries: Sequence[QueueEntry], count: int, again: Collection[str]
    ) -> list[tuple[ev.EventPayload, str]]:
        """Continue a session that has `alarms`, waiting `entries`, and `count` missions so far.

        The open alarms whose ids are in `again` become missions again. Returns the events to emit.
        """
        self.alarms, self._count = alarms, count
        open_alarms = {alarm.id: alarm for alarm in alarms.open}
        self.queue.resume(
            [e for e in entries if not e.mission.alarm or e.mission.alarm in open_alarms],
            open_alarms,
        )
        return self._answers([open_alarms[name] for name in again if name in open_alarms], ())

    def submit(
        self,
        order: ReadText,
        active: bool,
        *,
        agent: str = "",
        proposed: Plan | None = None,
        waits: bool = True,
        offered: bool = False,
    ) -> tuple[Mission, ev.MissionReceived]:
        """Queue an operator's mission, or a proposal of `agent` with its plan, if any.

        If `waits` is False, the mission was already carried out and is not queued. If `offered`,
        it was not typed by the operator. Raises ValueError if the mission is not accepted.
        """
        words = order.typed
        if not order.text:
            raise ValueError("the mission is empty: enter an order")
        letters = words.strip(" .,!?")
        if letters.isalpha() and len(letters) < LEAST_LETTERS and not agent:
            raise ValueError(
                f"“{words}” is not an order and was not sent: decide on a plan in its panel"
            )
        if len(words) > MAX_MISSION_TEXT:
            raise ValueError(
                f"the mission has {len(words)} characters, but the limit is {MAX_MISSION_TEXT}"
            )
        right = order.text[:MAX_MISSION_TEXT]
        typed = words if right != words else ""
        mission = Mission(
            id=self._new_id(),
            text=right,
            typed=typed,
            source="agent" if agent else "operator",
            created=datetime.now(UTC),
            agent=agent,
            proposed=proposed,
            offered=offered,
        )
        if not waits:
            return mission, ev.MissionReceived(mission=mission, position=0)
        self.queue.add(mission, None)
        return mission, ev.MissionReceived(
            mission=mission, position=self._position(mission) + active
        )

    def wait_again(self, mission: Mission) -> tuple[Mission, ev.MissionReceived]:
        """Queue another session's mission as a new mission of this session with the same text."""
        changes = {"id": self._new_id(), "created": datetime.now(UTC)}
        again = mission.model_copy(update=changes)
        self.queue.add(again, None)
        return again, ev.MissionReceived(mission=again, position=self._position(again))

    def start(self, due: Due) -> tuple[Mission, ev.MissionReceived]:
        """Queue the mission that a standing order starts."""
        mission = Mission(
            id=self._new_id(),
            text=due.start.order[:MAX_MISSION_TEXT],
            source="standing",
            created=datetime.now(UTC),
            standing=due.order.id,
            subject=due.subject or None,
            gate=due.gate,
        )
        self.queue.add(mission, None)
        return mission, ev.MissionReceived(mission=mission, position=self._position(mission))

    @property
    def subjects(self) -> frozenset[str]:
        """The subjects of the waiting missions, which are assets, tracks and gates."""
        waiting = (mission.subject for mission in self.queue.missions)
        return frozenset(subject for subject in waiting if subject is not None)

    def put_back(self, mission: Mission) -> bool:
        """Queue a mission again that gave way to another; return False if its alarm was cleared."""
        alarm = self.alarm_of(mission)
        if mission.alarm and alarm is None:
            return False
        self.queue.add(mission, alarm)
        return True

    def emergency(self, active: Mission, *, moving: bool = True) -> QueueEntry | None:
        """Return the waiting mission that goes before `active` (WF-04); None if there is none."""
        return self.queue.preempts(active, self.alarm_of(active), moving=moving)

    def alarm_of(self, mission: Mission) -> Alarm | None:
        """Return the open alarm that `mission` answers; None if there is none."""
        return next((a for a in self.alarms.open if a.id == mission.alarm), None)

    def move(self, mission_id: str, by: int) -> None:
        """Move a waiting mission by `by` places; raises ValueError if it does not wait."""
        for _ in range(abs(by)):
            self.queue.move(mission_id, "up" if by < 0 else "down")

    def changes(self) -> Iterable[ev.QueueChanged]:
        """Yield the queue if its order, a priority or a deferral changed since the last call."""
        entries = self.queue.entries
        order = tuple((entry.mission.id, entry.priority, entry.deferred) for entry in entries)
        if order != self._emitted:
            self._emitted = order
            yield ev.QueueChanged(entries=entries)

    def _answers(
        self, alarms: Iterable[Alarm], handled: Collection[str]
    ) -> list[tuple[ev.EventPayload, str]]:
        """Queue a mission for each alarm that has a command but no mission; return the events.

        An alarm is postponed if there is no room for its mission.
        """
        queued = {mission.alarm for mission in self.queue.missions if mission.source == "alarm"}
        sensors = self.alarms.sensors
        alike = Counter(sensors.get(alarm_id) for alarm_id in queued)
        made: list[tuple[ev.EventPayload, str]] = []
        for alarm in alarms:
            wanted = self._respond and alarm.command and alarm.subject not in handled
            if not wanted or alarm.id in queued:
                continue
            group = sensors.get(alarm.id)
            full = group is not None and alike[group] >= MOST_ALIKE
            if full or len(queued) >= MOST_FROM_ALARMS:
                self._postponed.add(alarm.id)
                continue
            queued.add(alarm.id)
            alike[group] += 1
            made.append(self._mission_for(alarm))
        return made

    def _mission_for(self, alarm: Alarm) -> tuple[ev.EventPayload, str]:
        mission = Mission(
            id=self._new_id(),
            text=alarm.command,
            source="alarm",
            created=datetime.now(UTC),
            alarm=alarm.id,
            subject=alarm.subject,
            gate=alarm.gate,
        )
        self.queue.add(mission, alarm)
        received = ev.MissionReceived(mission=mission, position=self._position(mission))
        return received, mission.id

    def _position(self, mission: Mission) -> int:
        return self.queue.position(mission.id)

    def _new_id(self) -> str:
        self._count += 1
        return f"M{self._count:03d}-{self._session[-4:]}"
