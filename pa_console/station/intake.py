"""Step 1: alarms become missions, missions wait for their turn, and some never get one.

Missions wait by their priority (WF-04, WF-05); the operator's wins.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import combinations
from math import inf
from typing import Literal, NamedTuple

from pa_console.language.questions import Question, read_question
from pa_console.language.references.scene import ReferenceScene
from pa_console.mission.orders.spelling import read_words
from pa_console.mission.orders.standing import Due
from pa_console.policy.plain_text import compatible_form
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.base import ALARM_PRIORITIES, AlarmPriority
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
from pa_console.station.alarms import MOST_ALIKE, AlarmBook

IS_STOPPED = "everything is stopped: no mission is taken until the stop is released"
MOST_FROM_ALARMS = 32
"""Most missions from alarms that wait at a time: hours of work for one operator. The other alarms
get their missions once there is room, the most urgent first. At most MOST_ALIKE of the missions are
about contacts of the same sensors, so that a sensor that lies leaves room for the others."""


class ReadText(NamedTuple):
    """A text of an operator's, read once: a mission, or a question about the record."""

    typed: str
    """The words as typed."""
    text: str
    """The words as they show, with misspellings put right."""
    question: Question | None = None


def read_text(text: str, scene: ReferenceScene, rulebook: Rulebook) -> ReadText:
    """Read a text: slips of the hand are put right, in a question as in a mission."""
    typed, shown = " ".join(text.split()), " ".join(compatible_form(text).split())
    if not shown or len(typed) > MAX_MISSION_TEXT:
        return ReadText(typed, shown)
    right = read_words(shown, scene.world, rulebook)
    question = read_question(scene, right)
    return ReadText(typed, right, question and replace(question, text=typed))


@dataclass
class Arrivals:
    """The outcome of a new picture: events to emit, and queued missions whose cause is gone."""

    payloads: list[tuple[ev.EventPayload, str | None]] = field(
        default_factory=list[tuple[ev.EventPayload, str | None]]
    )
    obsolete: list[Mission] = field(default_factory=list[Mission])


class Intake:
    """The alarms of the site and the waiting missions; yields events, without a simulator."""

    def __init__(self, world: World, session: str, *, respond: bool) -> None:
        """Make an intake without alarms; with `respond`, alarms become missions."""
        self.alarms, self.queue = AlarmBook(world), MissionQueue()
        self._session, self._respond = session, respond
        self._count = 0
        self._told: tuple[tuple[str, str, bool], ...] = ()
        self._postponed: set[str] = set()
        """Open alarms that get a mission once there is room."""

    def look(
        self, picture: Picture, handled: Collection[str], *, stopped: bool = False
    ) -> Arrivals:
        """Take in a new picture: alarms come and go, and missions with them.

        An alarm about one of `handled`, what the active mission deals with, needs no other one.
        While everything is `stopped` no alarm becomes a mission.
        """
        arrivals = Arrivals()
        for payload in self.alarms.look(picture):
            arrivals.payloads.append((payload, None))
            match payload:
                case ev.AlarmRaised(alarm=alarm) if not stopped:
                    arrivals.payloads += self._answers([alarm], handled)
                case ev.AlarmCleared(alarm_id=alarm_id):
                    arrivals.obsolete += self.queue.take(lambda one: one.alarm == alarm_id)
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
        """Queue a mission for every open alarm that no mission answers: the stop was released."""
        return self._answers(self.alarms.open, handled)

    def take_up(
        self, alarms: AlarmBook, entries: Sequence[QueueEntry], count: int, again: Collection[str]
    ) -> list[tuple[ev.EventPayload, str]]:
        """Continue with the alarms of a session, the waiting missions, and `count` missions so far.

        The open alarms whose ids are in `again` become missions again. Returns the events to emit.
        """
        self.alarms, self._count = alarms, count
        known = {alarm.id: alarm for alarm in alarms.open}
        self.queue.resume(
            [e for e in entries if not e.mission.alarm or e.mission.alarm in known], known
        )
        return self._answers([known[name] for name in again if name in known], ())

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
        """Queue an operator's mission, or a proposal by `agent`, with its plan if it has one.

        Without `waits`, it is already carried out; an `offered` mission was not typed.

        Raises ValueError if it is not accepted.
        """
        words = order.typed
        if not order.text:
            raise ValueError("the mission is empty: say what is to be done")
        letters = words.strip(" .,!?")
        if letters.isalpha() and len(letters) < LEAST_LETTERS and not agent:
            raise ValueError(
                f"“{words}” is no order, and was not sent: a plan is decided on in its panel"
            )
        if len(words) > MAX_MISSION_TEXT:
            raise ValueError(
                f"the mission has {len(words)} characters, at most {MAX_MISSION_TEXT} are taken"
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
        """Queue the words of a mission of another session, as one of this session."""
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
        """The assets, tracks and gates that the missions that wait are about."""
        waiting = (mission.subject for mission in self.queue.missions)
        return frozenset(subject for subject in waiting if subject is not None)

    def put_back(self, mission: Mission) -> bool:
        """Queue a mission again that had to give way; False when its alarm has gone meanwhile."""
        alarm = self.alarm_of(mission)
        if mission.alarm and alarm is None:
            return False
        self.queue.add(mission, alarm)
        return True

    def emergency(self, active: Mission, *, moving: bool = True) -> QueueEntry | None:
        """Return the waiting mission that goes before `active`, if one does (WF-04)."""
        return self.queue.preempts(active, self.alarm_of(active), moving=moving)

    def alarm_of(self, mission: Mission) -> Alarm | None:
        """Return the open alarm that `mission` answers."""
        return next((a for a in self.alarms.open if a.id == mission.alarm), None)

    def move(self, mission_id: str, by: int) -> None:
        """Move a waiting mission by `by` places; raises ValueError when it does not wait."""
        for _ in range(abs(by)):
            self.queue.move(mission_id, "up" if by < 0 else "down")

    def changes(self) -> Iterable[ev.QueueChanged]:
        """Yield the queue if its order, a priority or a deferral has changed since last time."""
        entries = self.queue.entries
        order = tuple((entry.mission.id, entry.priority, entry.deferred) for entry in entries)
        if order != self._told:
            self._told = order
            yield ev.QueueChanged(entries=entries)

    def _answers(
        self, alarms: Iterable[Alarm], handled: Collection[str]
    ) -> list[tuple[ev.EventPayload, str]]:
        """Queue a mission for each alarm that asks for one and has none; return the events.

        An alarm for whose mission there is no room is postponed.
        """
        queued = {mission.alarm for mission in self.queue.missions if mission.source == "alarm"}
        sensors = self.alarms.sensors
        alike = Counter(sensors.get(alarm_id) for alarm_id in queued)
        made: list[tuple[ev.EventPayload, str]] = []
        for alarm in alarms:
            wanted = self._respond and alarm.command and alarm.subject not in handled
            if not wanted or alarm.id in queued:
                continue
            same = sensors.get(alarm.id)
            full = same is not None and alike[same] >= MOST_ALIKE
            if full or len(queued) >= MOST_FROM_ALARMS:
                self._postponed.add(alarm.id)
                continue
            queued.add(alarm.id)
            alike[same] += 1
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


MOST_REMEMBERED = 1024
"""Most missions whose order of arrival is kept for when they come back, the latest ones."""

OPERATOR_PRIORITY: AlarmPriority = "high"
"""An operator's mission ranks so, before the alarms of the same priority."""
AGENT_PRIORITY: AlarmPriority = "low"
"""A proposal of an agent ranks so, behind every mission of an operator or an alarm."""


@dataclass
class _Waiting:
    """A mission that waits; `arrival` counts from the first time that it was queued."""

    mission: Mission
    alarm: Alarm | None
    arrival: int
    deferred: bool = False
    moved: bool = False

    @property
    def priority(self) -> AlarmPriority:
        if self.alarm is not None:
            return self.alarm.priority
        return AGENT_PRIORITY if self.mission.source == "agent" else OPERATOR_PRIORITY

    @property
    def distance_m(self) -> float | None:
        return self.alarm.distance_m if self.alarm is not None else None

    @property
    def rank(self) -> tuple[bool, bool, int, bool, float, int]:
        """Deferred ones last, before them agents' and the offer; then threat, own, distance."""
        distance = self.distance_m if self.distance_m is not None else inf
        own = self.mission.source != "operator"
        threat = ALARM_PRIORITIES.index(self.priority)
        late = self.mission.source == "agent" or self.mission.offered
        return self.deferred, late, threat, own, distance, self.arrival


LEAST_LETTERS = 3
"""A shorter text is a key that was meant for a panel, and no order."""


class MissionQueue:
    """Missions by id; a total order that depends on what was added and moved, on nothing else."""

    def __init__(self) -> None:
        self._waiting: dict[str, _Waiting] = {}
        self._before: set[tuple[str, str]] = set()
        """Pairs (a, b): the operator wants a before b."""
        self._arrivals: dict[str, int] = {}
        self._arrived = 0

    def add(self, mission: Mission, alarm: Alarm | None = None) -> None:
        """Queue a mission, or queue it again in its old place among equals.

        Raises ValueError when it waits already.
        """
        if mission.id in self._waiting:
            raise ValueError(f"{mission.id} waits already")
        if mission.id not in self._arrivals:
            self._arrivals[mission.id] = self._arrived
            self._arrived += 1
            if len(self._arrivals) > MOST_REMEMBERED:
                del self._arrivals[next(iter(self._arrivals))]
        self._waiting[mission.id] = _Waiting(mission, alarm, self._arrivals[mission.id])

    def resume(self, entries: Sequence[QueueEntry], alarms: Mapping[str, Alarm]) -> None:
        """Queue the missions of `entries` as they waited, with the open `alarms` by their ids."""
        for entry in sorted(entries, key=lambda entry: entry.mission.created):
            self.add(entry.mission, alarms.get(entry.mission.alarm))
            self._waiting[entry.mission.id].deferred = entry.deferred
        wanted = [entry.mission.id for entry in entries]
        if [entry.mission.id for entry in self._order()] != wanted:
            self._before = set(combinations(wanted, 2))

    def pop_next(self) -> Mission | None:
        """Take out and return the mission whose turn it is; None when nothing waits."""
        order = self._order()
        return self.remove(order[0].mission.id) if order else None

    def remove(self, mission_id: str) -> Mission:
        """Take a mission out and return it; raises ValueError when it does not wait."""
        mission = self._find(mission_id).mission
        del self._waiting[mission_id]
        self._release(mission_id)
        return mission

    def take(self, which: Callable[[Mission], bool] = lambda _: True) -> tuple[Mission, ...]:
        """Take out and return the missions that `which` is true of, by default all; next first."""
        found = [entry.mission for entry in self._order() if which(entry.mission)]
        return tuple(self.remove(mission.id) for mission in found)

    def defer(self, mission_id: str, deferred: bool = True) -> None:
        """Let everything else go before a mission, or no longer; ValueError if it does not wait."""
        entry = self._find(mission_id)
        entry.deferred, entry.moved = deferred, False
        self._release(mission_id)

    def move(self, mission_id: str, to: Literal["up", "down"]) -> None:
        """Move a mission one place; at the end of the queue it stays where it is.

        It keeps its place among the waiting missions; later ones are placed before or after it by
        rank. A deferred mission is no longer deferred. Raises ValueError if the mission does not
        wait.
        """
        entry = self._find(mission_id)
        ids = [other.mission.id for other in self._order()]
        old = ids.index(mission_id)
        new = old - 1 if to == "up" else old + 1
        if not 0 <= new < len(ids):
            return
        ids.remove(mission_id)
        self._release(mission_id)
        self._before |= {(other, mission_id) for other in ids[:new]}
        self._before |= {(mission_id, other) for other in ids[new:]}
        entry.deferred, entry.moved = False, True

    def let_first(self, mission_id: str, active: str) -> None:
        """Let a mission go before the others and before `active`, which will wait again.

        Raises ValueError when it does not wait.
        """
        others = {entry.mission.id for entry in self._waiting.values()} | {active}
        self._find(mission_id)
        self._release(mission_id)
        self._before |= {(mission_id, other) for other in others - {mission_id}}

    def refresh(self, alarms: Iterable[Alarm]) -> None:
        """Take priorities and distances from the alarms as they stand now."""
        known = {alarm.id: alarm for alarm in alarms}
        for entry in self._waiting.values():
            if entry.alarm is not None:
                entry.alarm = known.get(entry.alarm.id, entry.alarm)

    @property
    def missions(self) -> tuple[Mission, ...]:
        """Every mission that waits, in no order."""
        return tuple(entry.mission for entry in self._waiting.values())

    def position(self, mission_id: str) -> int:
        """Return how many missions go before one that waits."""
        return [entry.mission.id for entry in self._order()].index(mission_id)

    @property
    def entries(self) -> tuple[QueueEntry, ...]:
        """Every mission that waits, next first, each with why it stands there."""
        order = self._order()
        return tuple(
            QueueEntry(
                mission=entry.mission,
                priority=entry.priority,
                distance_m=entry.distance_m,
                deferred=entry.deferred,
                reason=_reason(entry, order[place - 1] if place else None),
            )
            for place, entry in enumerate(order)
        )

    def preempts(
        self, active: Mission, active_alarm: Alarm | None, *, moving: bool = True
    ) -> QueueEntry | None:
        """Return the next entry if it must not wait for `active`.

        That is an emergency, unless `active` is one. If `active` is an agent's proposal that no
        asset is `moving` for, it is any mission that no agent has proposed. Everything comes before
        the policy that the world offers.
        """
        mine = active_alarm.priority if active_alarm is not None else OPERATOR_PRIORITY
        first = next(iter(self.entries), None)
        if first is None or first.deferred or first.mission.id == active.id:
            return None
        if active.offered:
            return first
        if active.source == "agent" and first.mission.source != "agent" and not moving:
            return first
        return first if first.priority == "emergency" and mine != "emergency" else None

    def _find(self, mission_id: str) -> _Waiting:
        if mission_id not in self._waiting:
            known = ", ".join(self._waiting) or "none"
            raise ValueError(f"{mission_id} does not wait; waiting: {known}")
        return self._waiting[mission_id]

    def _release(self, mission_id: str) -> None:
        """Forget where the operator had moved a mission."""
        self._before = {pair for pair in self._before if mission_id not in pair}

    def _order(self) -> list[_Waiting]:
        """Sort by rank, but never against the operator: always the first that nothing holds back.

        What was moved has a pair with everything that waited then, in the order that resulted, so
        the pairs cannot form a circle.
        """
        rest = sorted(self._waiting.values(), key=lambda entry: entry.rank)
        order: list[_Waiting] = []
        while rest:
            left = {entry.mission.id for entry in rest}
            held = {after for before, after in self._before if before in left}
            following = next(entry for entry in rest if entry.mission.id not in held)
            rest.remove(following)
            order.append(following)
        return order


def _reason(entry: _Waiting, before: _Waiting | None) -> str:
    """Return in words why `entry` comes after `before`, or first."""
    if entry.deferred:
        return "deferred by the operator: its turn comes when nothing else waits"
    if entry.moved:
        return f"{entry.priority}, moved here by the operator"
    alarm = entry.alarm
    what = "the operator's own mission" if entry.mission.source == "operator" else entry.priority
    if entry.mission.standing:
        what = f"started by standing order {entry.mission.standing}"
    if entry.mission.agent:
        what = entry.mission.origin
    if alarm is not None and alarm.distance_m is not None:
        what += f", {alarm.distance_m:.0f} m from {alarm.gate or 'its gate'}"
    if entry.priority == "emergency" and before is None:
        return f"{what}: an emergency goes before everything else (WF-04)"
    if alarm is not None and alarm.kind == "low_battery":
        return f"{what}: a low battery waits until the active mission is over (WF-05)"
    if before is None:
        return f"{what}: next"
    return f"{what}: {_comparison(entry, before)}"


def _comparison(entry: _Waiting, before: _Waiting) -> str:
    other = before.mission.id
    if entry.mission.agent and not before.mission.agent:
        return f"{other} goes first: proposals come last"
    if before.moved or entry.rank < before.rank:
        return f"after {other}, as the operator ordered"
    if entry.priority != before.priority:
        return f"waits until {other} of higher threat is over (WF-05)"
    if before.mission.source == "operator" and entry.mission.source != "operator":
        return f"after {other}: the operator's own goes first"
    if (entry.distance_m if entry.distance_m is not None else inf) != (
        before.distance_m if before.distance_m is not None else inf
    ):
        return f"{other} is nearer (WF-04)"
    return f"arrived after {other}"
