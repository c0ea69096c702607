"""Alarms of a site: raised once per cause, kept open during noise, and cleared with the cause."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from pa_console.mission.report import CLEARS_WHEN
from pa_console.schema.base import ALARM_PRIORITIES, AlarmPriority
from pa_console.schema.events.event import AlarmAcknowledged, AlarmCleared, AlarmRaised
from pa_console.schema.mission import Alarm, AlarmKind
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.station.alarms.alarm_causes import (
    AlarmTopic,
    Cause,
    almost_low,
    causes,
    many_contacts,
)

Key = tuple[AlarmTopic, str]
AlarmChange = AlarmRaised | AlarmCleared
Sensors = tuple[str, ...]
OF_TRACKS: tuple[AlarmTopic, ...] = ("threat", "track", "way")
"""The topics of alarms about contacts, of which a sensor may report any number."""
MOST_MINOR = 12
"""The largest number of medium and low alarms of one kind that are open at a time.

Further alarms wait. Alarms about contacts have the limit MOST_ALIKE instead.
"""
MOST_ALIKE = 8
"""The largest number of open alarms of one kind about contacts of the same sensors.

Emergency and high alarms are counted together, and so are medium and low alarms. Beyond the limit,
one more alarm names the sensors and counts their other contacts. Therefore, a sensor with false
reports cannot hide the contacts of other sensors.
"""
MOST_IDS = 1024
"""The largest number of subjects whose alarm ids are kept, because the number of tracks is
unlimited. The latest ids are kept."""


@dataclass
class _WatchedCause:
    """A cause under observation.

    It has had its current kind since `since_s` and was last present at `seen_s`, both in simulated
    seconds. `sensors` are all sensors that have detected its track.
    """

    cause: Cause
    since_s: float
    seen_s: float
    alarm: Alarm | None = None
    sensors: Sensors = ()

    def counts_as(self, kind: AlarmKind, priority: AlarmPriority) -> "_Alike | None":
        """Return the group to which an alarm with these values belongs; None if it has no limit."""
        minor = priority in ("medium", "low")
        if self.cause.topic in OF_TRACKS:
            return _Alike(kind, minor, self.sensors)
        return _Alike(kind, minor) if minor else None


class _Alike(NamedTuple):
    """A group of alarms with a common limit: of the same kind, and either all minor or all not.

    Alarms about contacts are in the same group only if they have the same sensors.
    """

    kind: AlarmKind
    minor: bool
    sensors: Sensors | None = None
    """The sensors that report the contacts; None if the alarms are not about contacts."""

    @property
    def most(self) -> int:
        return MOST_MINOR if self.sensors is None else MOST_ALIKE


@dataclass
class AlarmBook:
    """The alarms derived from successive pictures (paper, Section IV-C).

    Equal pictures give equal alarms. An alarm keeps its id as long as its subject exists, so an
    alarm that returns has the same id. If its kind changes or its priority rises, it is raised
    again under that id. A track that becomes a threat gets a new alarm, which supersedes the old
    one.
    """

    world: World
    acknowledged: set[str] = field(default_factory=set[str])
    _watched: dict[Key, _WatchedCause] = field(default_factory=dict[Key, _WatchedCause])
    _ids: dict[Key, str] = field(default_factory=dict[Key, str])
    _numbered: int = 0
    _guards: dict[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])

    @property
    def open(self) -> tuple[Alarm, ...]:
        """The open alarms: the highest priority first, then the nearest, then the oldest."""
        alarms = [entry.alarm for entry in self._watched.values() if entry.alarm is not None]
        return tuple(sorted(alarms, key=_open_order))

    @property
    def sensors(self) -> dict[str, Sensors | None]:
        """The sensors of each open alarm's contact, by alarm id; None if it has no contact."""
        return {
            entry.alarm.id: entry.sensors if key[0] in OF_TRACKS else None
            for key, entry in self._watched.items()
            if entry.alarm is not None
        }

    def acknowledge(self, alarm_id: str, by: str) -> AlarmAcknowledged:
        """Record that `by` has seen an open alarm; raises ValueError if it is not open."""
        open_ids = [alarm.id for alarm in self.open]
        if alarm_id not in open_ids:
            raise ValueError(
                f"no alarm {alarm_id!r} is open; open: {', '.join(open_ids) or 'none'}"
            )
        self.acknowledged.add(alarm_id)
        return AlarmAcknowledged(alarm_id=alarm_id, by=by)

    def look(self, picture: Picture) -> list[AlarmChange]:
        """Process a new picture; return the cleared alarms, then the raised alarms by priority."""
        self._remember_guards(picture)
        shown = {cause.key: cause for cause in causes(picture, self.world, self._guards)}
        self._observe(shown, picture)
        raised = self._raise(picture.time_s)
        cleared = self._clear(picture.time_s, raised)
        return [*cleared, *raised]

    def _remember_guards(self, picture: Picture) -> None:
        """Record which assets certainly covered each gate last, until they leave it."""
        for gate, cover in picture.gates.items():
            if cover.covered:
                self._guards[gate] = cover.by
            else:
                self._guards[gate] = tuple(
                    name
                    for name in self._guards.get(gate, ())
                    if name in picture.assets
                    and (not picture.assets[name].available or picture.assets[name].post == gate)
                )

    def _observe(self, shown: dict[Key, Cause], picture: Picture) -> None:
        now_s = picture.time_s
        for key, cause in shown.items():
            entry = self._watched.get(key)
            if entry is None:
                if cause.raises:
                    before = self._watched.get(("track", cause.subject))
                    sensors_before = before.sensors if before is not None else ()
                    sensors = _both(sensors_before, cause.sensors)
                    self._watched[key] = _WatchedCause(cause, now_s, now_s, sensors=sensors)
                continue
            entry.sensors = _both(entry.sensors, cause.sensors)
            if entry.alarm is not None:
                entry.alarm = entry.alarm.model_copy(
                    update={
                        "distance_m": cause.distance_m,
                        "text": cause.text,
                        "command": cause.command,
                    }
                )
            if entry.alarm is not None and cause.kind != entry.cause.kind:
                entry.since_s = now_s
            entry.cause, entry.seen_s = cause, now_s
        for key in almost_low(picture, self.world):
            entry = self._watched.get(key)
            if entry is not None and entry.alarm is not None:
                entry.seen_s = now_s

    def _raise(self, now_s: float) -> list[AlarmRaised]:
        """Raise alarms for settled causes; raise one again at a new kind or a higher priority."""
        due = [
            entry
            for entry in self._watched.values()
            if entry.seen_s == now_s
            and entry.cause.raises
            and _settled(entry)
            and (entry.alarm is None or _changed(entry.alarm, entry.cause))
            and not self._outdone(entry.cause)
        ]
        opened = self._opened()
        held: dict[Sensors, list[Cause]] = {}
        raised: list[AlarmRaised] = []
        for entry in sorted(due, key=lambda entry: _cause_order(entry.cause)):
            alarm, cause = entry.alarm, entry.cause
            before = entry.counts_as(alarm.kind, alarm.priority) if alarm is not None else None
            alike = entry.counts_as(cause.kind, cause.priority)
            if alike is not None and alike != before and opened[alike] >= alike.most:
                if alike.sensors is not None and not alike.minor:
                    held.setdefault(alike.sensors, []).append(cause)
                if alike.sensors is not None or alarm is None:
                    continue
            opened[before] -= 1
            opened[alike] += 1
            entry.alarm = self._alarm(entry, now_s)
            raised.append(AlarmRaised(alarm=entry.alarm))
        raised += self._sum_up(held, opened, now_s)
        return sorted(raised, key=lambda change: ALARM_PRIORITIES.index(change.alarm.priority))

    def _sum_up(
        self, held: Mapping[Sensors, Sequence[Cause]], opened: Counter[_Alike | None], now_s: float
    ) -> list[AlarmRaised]:
        """Keep one alarm open for each group of sensors with contacts beyond the limit."""
        raised: list[AlarmRaised] = []
        for sensors, rest in held.items():
            beside = sum(
                number
                for alike, number in opened.items()
                if alike is not None and alike.sensors == sensors and not alike.minor
            )
            cause = many_contacts(sensors, rest, beside)
            entry = self._watched.setdefault(cause.key, _WatchedCause(cause, now_s, now_s))
            entry.cause, entry.seen_s = cause, now_s
            if entry.alarm is None or _changed(entry.alarm, cause):
                entry.alarm = self._alarm(entry, now_s)
                raised.append(AlarmRaised(alarm=entry.alarm))
            else:
                entry.alarm = entry.alarm.model_copy(update={"text": cause.text})
        return raised

    def _opened(self) -> Counter[_Alike | None]:
        """Return the number of open alarms in each group."""
        return Counter(
            entry.counts_as(entry.alarm.kind, entry.alarm.priority)
            for entry in self._watched.values()
            if entry.alarm is not None
        )

    def _clear(self, now_s: float, raised: Iterable[AlarmRaised]) -> list[AlarmCleared]:
        """Clear alarms whose cause is gone, or is superseded by a threat.

        Causes that are gone before they raised an alarm are forgotten.
        """
        threats = {r.alarm.subject: r.alarm.id for r in raised if r.alarm.priority == "emergency"}
        cleared: list[AlarmCleared] = []
        for key, entry in list(self._watched.items()):
            gone = now_s - entry.seen_s
            if entry.alarm is None:
                if gone > min(1.0, entry.cause.settle_s):
                    del self._watched[key]
                continue
            reason = CLEARS_WHEN[entry.alarm.kind] if gone > entry.cause.linger_s else ""
            if key[0] == "track" and key[1] in threats:
                reason = f"superseded by {threats[key[1]]}"
            if reason:
                cleared.append(AlarmCleared(alarm_id=entry.alarm.id, reason=reason))
                self.acknowledged.discard(entry.alarm.id)
                del self._watched[key]
        return sorted(cleared, key=lambda change: change.alarm_id)

    def _alarm(self, entry: _WatchedCause, now_s: float) -> Alarm:
        cause = entry.cause
        return Alarm(
            id=entry.alarm.id if entry.alarm is not None else self._id_of(cause.key),
            kind=cause.kind,
            priority=cause.priority,
            subject=cause.subject,
            gate=cause.gate,
            text=cause.text,
            command=cause.command,
            raised_s=entry.alarm.raised_s if entry.alarm is not None else now_s,
            distance_m=cause.distance_m,
        )

    def _outdone(self, cause: Cause) -> bool:
        """Return whether a threat alarm about the same track is open."""
        threat = self._watched.get(("threat", cause.subject)) if cause.topic == "track" else None
        return threat is not None

    def _id_of(self, key: Key) -> str:
        """Return the id for an alarm with this key: the earlier id if it is kept, else a new id."""
        alarm_id = self._ids.pop(key, "")
        if not alarm_id:
            self._numbered += 1
            alarm_id = f"A{self._numbered:03d}"
        self._ids[key] = alarm_id
        if len(self._ids) > MOST_IDS:
            del self._ids[next(iter(self._ids))]
        return alarm_id


def _settled(entry: _WatchedCause) -> bool:
    return entry.seen_s - entry.since_s >= entry.cause.settle_s - 1e-6


def _changed(alarm: Alarm, cause: Cause) -> bool:
    """Return whether the alarm must be raised again, for a new kind or a higher priority."""
    worse = ALARM_PRIORITIES.index(cause.priority) < ALARM_PRIORITIES.index(alarm.priority)
    return cause.kind != alarm.kind or worse


def _both(first: Sensors, second: Sensors) -> Sensors:
    """Return the union of two groups of sensors, sorted."""
    return tuple(sorted({*first, *second}))


def _cause_order(cause: Cause) -> tuple[int, float, str, str, str]:
    distance = cause.distance_m if cause.distance_m is not None else float("inf")
    rank = ALARM_PRIORITIES.index(cause.priority)
    return rank, distance, cause.gate or "", cause.subject, cause.topic


def _open_order(alarm: Alarm) -> tuple[int, float, float, str, str]:
    distance = alarm.distance_m if alarm.distance_m is not None else float("inf")
    rank = ALARM_PRIORITIES.index(alarm.priority)
    return rank, distance, alarm.raised_s, alarm.gate or "", alarm.id
