"""The queue of waiting missions, ordered by priority (WF-04, WF-05).

At equal priority, a mission from an operator goes before a mission from an alarm.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import inf
from typing import Literal

from pa_console.schema.base import ALARM_PRIORITIES, AlarmPriority
from pa_console.schema.mission import Alarm, Mission, QueueEntry

MOST_REMEMBERED = 1024
"""The number of latest missions whose order of arrival is kept, in case they return."""

OPERATOR_PRIORITY: AlarmPriority = "high"
"""The priority of an operator's mission, which goes before alarms of the same priority."""
AGENT_PRIORITY: AlarmPriority = "low"
"""The priority of an agent's proposal, which goes after all missions of operators and alarms."""


@dataclass
class _Waiting:
    """A waiting mission; `arrival` is the number that it got when it was first queued."""

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
        """The sort key.

        It compares, in this order: deferred missions, missions from agents or offers, priority,
        missions not from an operator, distance, arrival.
        """
        distance = self.distance_m if self.distance_m is not None else inf
        own = self.mission.source != "operator"
        threat = ALARM_PRIORITIES.index(self.priority)
        late = self.mission.source == "agent" or self.mission.offered
        return self.deferred, late, threat, own, distance, self.arrival


class MissionQueue:
    """The waiting missions, in a total order that depends only on additions and moves."""

    def __init__(self) -> None:
        self._waiting: dict[str, _Waiting] = {}
        self._before: set[tuple[str, str]] = set()
        """The pairs (a, b) of missions of which the operator has put a before b."""
        self._arrivals: dict[str, int] = {}
        self._arrived = 0

    def add(self, mission: Mission, alarm: Alarm | None = None) -> None:
        """Queue a mission; if it was queued before, it gets its earlier place among equal missions.

        Raises ValueError if it already waits.
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
        """Queue the missions of `entries` in the same order; `alarms` has the open alarms by id."""
        for entry in sorted(entries, key=lambda entry: entry.mission.created):
            self.add(entry.mission, alarms.get(entry.mission.alarm))
            self._waiting[entry.mission.id].deferred = entry.deferred
        wanted = [entry.mission.id for entry in entries]
        if [entry.mission.id for entry in self._order()] != wanted:
            self._before = set(combinations(wanted, 2))

    def pop_next(self) -> Mission | None:
        """Remove and return the next mission; None if no mission waits."""
        order = self._order()
        return self.remove(order[0].mission.id) if order else None

    def remove(self, mission_id: str) -> Mission:
        """Remove a mission and return it; raises ValueError if it does not wait."""
        mission = self._find(mission_id).mission
        del self._waiting[mission_id]
        self._release(mission_id)
        return mission

    def take(self, which: Callable[[Mission], bool] = lambda _: True) -> tuple[Mission, ...]:
        """Remove and return the missions for which `which` is True, by default all, in order."""
        missions = [entry.mission for entry in self._order() if which(entry.mission)]
        return tuple(self.remove(mission.id) for mission in missions)

    def defer(self, mission_id: str, deferred: bool = True) -> None:
        """Put a mission behind all others; if `deferred` is False, put it back.

        Raises ValueError if the mission does not wait.
        """
        entry = self._find(mission_id)
        entry.deferred, entry.moved = deferred, False
        self._release(mission_id)

    def move(self, mission_id: str, to: Literal["up", "down"]) -> None:
        """Move a mission one place; at either end of the queue, it stays where it is.

        The mission keeps its place relative to the missions that wait now; missions that arrive
        later are placed by rank. A deferred mission is no longer deferred. Raises ValueError if the
        mission does not wait.
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
        """Put a mission before all others and before `active`, which will wait again.

        Raises ValueError if it does not wait.
        """
        others = {entry.mission.id for entry in self._waiting.values()} | {active}
        self._find(mission_id)
        self._release(mission_id)
        self._before |= {(mission_id, other) for other in others - {mission_id}}

    def refresh(self, alarms: Iterable[Alarm]) -> None:
        """Update priorities and distances from the open `alarms`."""
        by_id = {alarm.id: alarm for alarm in alarms}
        for entry in self._waiting.values():
            if entry.alarm is not None:
                entry.alarm = by_id.get(entry.alarm.id, entry.alarm)

    @property
    def missions(self) -> tuple[Mission, ...]:
        """The waiting missions, in no particular order."""
        return tuple(entry.mission for entry in self._waiting.values())

    def position(self, mission_id: str) -> int:
        """Return the number of missions that go before a waiting mission."""
        return [entry.mission.id for entry in self._order()].index(mission_id)

    @property
    def entries(self) -> tuple[QueueEntry, ...]:
        """The waiting missions, the next one first, each with the reason for its place."""
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

        An emergency does not wait, unless `active` is an emergency too. If `active` is an agent's
        proposal and no asset is `moving` for it, only other proposals wait for it. If `active` is
        offered by the world, no mission waits for it.
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
            waiting = ", ".join(self._waiting) or "none"
            raise ValueError(f"{mission_id} does not wait; waiting: {waiting}")
        return self._waiting[mission_id]

    def _release(self, mission_id: str) -> None:
        """Forget the operator's moves of a mission."""
        self._before = {pair for pair in self._before if mission_id not in pair}

    def _order(self) -> list[_Waiting]:
        """Return the missions by rank, except where the operator put one mission before another.

        When a mission is moved, it gets a pair with every mission that waits, in the resulting
        order. Therefore, the pairs cannot form a cycle.
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
    """Return the reason why `entry` comes after `before`, or comes first if `before` is None."""
    if entry.deferred:
        return "deferred by the operator: its turn comes when nothing else waits"
    if entry.moved:
        return f"{entry.priority}, moved here by the operator"
    alarm = entry.alarm
    origin = "the operator's own mission" if entry.mission.source == "operator" else entry.priority
    if entry.mission.standing:
        origin = f"started by standing order {entry.mission.standing}"
    if entry.mission.agent:
        origin = entry.mission.origin
    if alarm is not None and alarm.distance_m is not None:
        origin += f", {alarm.distance_m:.0f} m from {alarm.gate or 'its gate'}"
    if entry.priority == "emergency" and before is None:
        return f"{origin}: an emergency goes before everything else (WF-04)"
    if alarm is not None and alarm.kind == "low_battery":
        return f"{origin}: a low battery waits until the active mission is over (WF-05)"
    if before is None:
        return f"{origin}: next"
    return f"{origin}: {_comparison(entry, before)}"


def _comparison(entry: _Waiting, before: _Waiting) -> str:
    other = before.mission.id
    if entry.mission.agent and not before.mission.agent:
        return f"{other} goes first: proposals come last"
    if before.moved or entry.rank < before.rank:
        return f"after {other}, as the operator ordered"
    if entry.priority != before.priority:
        return f"waits until {other} of higher threat is over (WF-05)"
    if before.mission.source == "operator" and entry.mission.source != "operator":
        return f"after {other}: the operator's own mission goes first"
    if (entry.distance_m if entry.distance_m is not None else inf) != (
        before.distance_m if before.distance_m is not None else inf
    ):
        return f"{other} is nearer (WF-04)"
    return f"arrived after {other}"
