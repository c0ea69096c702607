"""Alarms of a site: raised once per cause, kept open through noise, cleared with the cause."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from pa_console.mission.planning.picture_text import silence
from pa_console.mission.report import CLEARS_WHEN
from pa_console.policy.moments import ways_out_shut
from pa_console.schema.base import ALARM_PRIORITIES, AlarmPriority
from pa_console.schema.events.event import AlarmAcknowledged, AlarmCleared, AlarmRaised
from pa_console.schema.mission import Alarm, AlarmKind
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Track
from pa_console.schema.world import World
from pa_console.session.wording import TRACK_PLACES

AlarmTopic = Literal["threat", "track", "way", "cover", "asset", "battery", "camera", "sensor"]
OF_TRACKS: tuple[AlarmTopic, ...] = ("threat", "track", "way")
"""The topics of alarms about contacts; a sensor may report any number of contacts."""
BATTERY_MARGIN_PCT = 3.0
"""The charge above the limit at which an open battery alarm may clear, in percent. It may also
clear when the asset returns to base or charges."""
MOST_MINOR = 12
"""The most medium and low alarms of one kind that are open at a time; the others wait."""
MOST_ALIKE = 8
"""The most emergency and high alarms of one kind about contacts of the same sensors, and the most
medium and low ones. One more alarm names the sensors and counts the other contacts, so a sensor
with false reports cannot hide the contacts of other sensors."""
MOST_IDS = 1024
"""The most subjects whose alarm ids are kept, the latest ones; the number of tracks is
unlimited."""


@dataclass(frozen=True)
class Cause:
    """One reason for an alarm; causes with the same topic and subject share one alarm.

    A cause must be present for `settle_s` before it raises an alarm, and absent for `linger_s`
    before the alarm clears, in simulated seconds. A cause with `raises` False only keeps an alarm
    open.
    """

    topic: AlarmTopic
    kind: AlarmKind
    priority: AlarmPriority
    subject: str
    gate: str | None
    text: str
    command: str = ""
    distance_m: float | None = None
    settle_s: float = 0.0
    linger_s: float = 3.0
    raises: bool = True
    sensors: tuple[str, ...] = ()
    """The sensors that detect the track."""

    @property
    def key(self) -> tuple[AlarmTopic, str]:
        """The key of the alarm: causes with the same key share one alarm."""
        return self.topic, " ".join(self.sensors) if self.topic == "sensor" else self.subject


def causes(picture: Picture, world: World, guards: Mapping[str, tuple[str, ...]]) -> list[Cause]:
    """Return every cause that `picture` shows.

    `guards` are the assets last known for certain to cover each gate. If one of them is lost, the
    gate's alarm names it and has the command in response; the asset's own alarm has none.
    """
    found = [cause for track in picture.tracks.values() if (cause := _track(track)) is not None]
    found.extend(_ways(picture, world))
    for gate, cover in picture.gates.items():
        if not cover.covered:
            found.append(_cover(picture, world, gate, cover, guards.get(gate, ())))
    alone = {names[0]: gate for gate, names in guards.items() if len(names) == 1}
    for asset in picture.assets.values():
        gate = alone.get(asset.id)
        found.extend(_asset(asset, gate, picture.time_s))
    found.extend(_cameras(picture, world))
    return found


def _track(track: Track) -> Cause | None:
    """Return the cause of an alarm about `track`; None if no alarm is needed.

    A leaving track needs none, and neither does an authorized one unless it is hostile or defiant.
    """
    if track.status == "leaving":
        return None
    known = "" if track.identity == "unknown" else f"{track.identity} "
    where = TRACK_PLACES[track.status].format(gate=track.gate)
    care = ". Noncombatants are suspected: only observe and report" if track.noncombatants else ""
    disputed = ", identity disputed" if track.dispute else ""
    topic, settle_s = "threat", 0.0
    if track.intent == "hostile":
        kind, priority, what = "hostile_track", "emergency", f"hostile {track.kind}"
        what, order = f"A {what} {where}", ". Block it." if track.warned else "."
    elif track.defiant:
        kind, priority = "defiant_track", "emergency"
        what = f"{_an(known or 'unknown ')}{track.kind} {where} in spite of a warning"
        order = ". Observe it and keep the gate covered."
    elif track.identity == "authorized":
        return None
    elif track.identity == "unauthorized":
        topic, kind = "track", "unauthorized_track"
        priority = "medium" if track.intent == "benign" else "high"
        what, order = f"An unauthorized {track.kind} {where}", ". Warn it to turn back."
        if track.warned:
            order = ""
    else:
        topic, kind, settle_s = "track", "unknown_track", 1.0
        priority = "medium" if track.intent == "benign" else "high"
        what, order = f"An unknown {track.kind} {where}", "."
    return Cause(
        topic, kind, priority, track.id, track.gate,
        text=f"{track.id}: {what[0].lower()}{what[1:]}, {track.distance_m:.0f} m{disputed}",
        command=f"{what}{care}." if order and care else f"{what}{order}" if order else "",
        distance_m=track.distance_m, settle_s=settle_s, linger_s=5.0, sensors=track.seen_by,
    )  # fmt: skip


def _ways(picture: Picture, world: World) -> Iterator[Cause]:
    """Yield a cause for each track that our assets block although it must pass (ROE-12, ROE-13).

    The situation may arise after the plan was checked, and only another order ends a block.
    """
    blockers = {
        asset.at: asset.id
        for asset in picture.assets.values()
        if asset.task == "blocking" and asset.at in picture.gates
    }
    shut = bool(blockers) and ways_out_shut(picture, world)
    for track in picture.tracks.values() if blockers else ():
        what = "emergency vehicle" if track.emergency else f"{track.identity} {track.kind}"
        person = track.kind == "person" or track.noncombatants
        let_through = track.emergency or track.identity == "authorized"
        if shut and track.status == "inside" and (person or let_through):
            where = f"is shut in: {', '.join(sorted(filter(None, blockers)))} are blocked"
        elif let_through and track.status != "leaving" and track.gate in blockers:
            where = f"waits at {track.gate}, which {blockers[track.gate]} blocks"
        else:
            continue
        yield Cause(
            "way", "way_blocked", "high", track.id, track.gate,
            text=f"{track.id}: {'an' if what[0] in 'aeiou' else 'a'} {what} {where}",
            distance_m=track.distance_m, settle_s=1.0, linger_s=3.0, sensors=track.seen_by,
        )  # fmt: skip


def many_contacts(sensors: tuple[str, ...], held: Sequence[Cause], opened: int) -> Cause:
    """Return one cause that replaces the causes `held`, which get no alarms of their own.

    `held` is sorted, the most urgent first. `opened` is the number of open alarms about contacts of
    the same `sensors`.
    """
    needs, number = "contacts that need a response", opened + len(held)
    if len(sensors) == 1:
        reported = f"{sensors[0]} alone reports {number} {needs}"
    elif sensors:
        reported = f"{', '.join(sensors)} report {number} {needs}"
    else:
        reported = f"{number} {needs} are reported by no sensor now"
    worst = held[0]
    return Cause(
        "sensor", "many_contacts", worst.priority, sensors[0] if sensors else worst.subject,
        worst.gate, text=f"{reported}: {opened} have an alarm each, the rest is set aside",
        linger_s=5.0, sensors=sensors,
    )  # fmt: skip


def _cover(
    picture: Picture, world: World, gate: str, cover: GateCover, guards: tuple[str, ...]
) -> Cause:
    """Return the cause of an alarm about a gate without certain cover.

    A hand-over may take half the grace time (WF-03). If the guard is known to be lost, there is no
    hand-over, so the alarm is raised after one second.
    """
    if cover.unknown:
        unsure = [picture.assets[name] for name in cover.unsure if name in picture.assets]
        why = ", ".join(filter(None, (silence(picture, asset) for asset in unsure)))
        silent = all(asset.comms == "lost" for asset in unsure)
        return Cause(
            "cover", "coverage_unknown", "high" if silent else "medium", gate, gate,
            text=f"nobody knows whether {gate} is covered: {why or 'its guard is not heard'}",
            command=f"Nobody knows whether {gate} has a guard: fill the gap at {gate}.",
            settle_s=world.stale_s,
        )  # fmt: skip
    away = [picture.assets[name] for name in guards if name in picture.assets]
    driven = [f"{asset.id} is under manual control" for asset in away if asset.manual]
    failed = [
        silence(picture, asset) or f"{asset.id} has failed"
        for asset in away
        if not (asset.available or asset.manual)
    ]
    lost = [*failed, *driven]
    return Cause(
        "cover", "coverage_lost", "emergency" if lost else "high", gate, gate,
        text=f"{gate} is not covered" + (f": {', '.join(lost)}" if lost else ""),
        command=f"{failed[0] if failed else f'{gate} has no guard'}: fill the gap at {gate}.",
        settle_s=1.0 if lost else world.coverage_grace_s / 2,
        linger_s=2.0,
    )  # fmt: skip


def _asset(asset: AssetTelemetry, alone_at: str | None, time_s: float) -> Iterator[Cause]:
    """Yield the cause of an asset: the worst of failed, silent and suspect, or its battery."""
    place = alone_at or (asset.at if asset.at == asset.post else None)
    priority: AlarmPriority = "high" if alone_at else "medium"
    name = f"{asset.id} at {place}" if place else asset.id
    trouble: tuple[AlarmKind, str, float] | None = None
    if asset.status == "failed":
        trouble = "asset_failed", f"{name} has failed", 0.0
    elif asset.comms == "lost":
        silent_s = time_s - asset.stamp_s
        trouble = "link_lost", f"{name} has been silent for {silent_s:.0f} s", 0.0
    elif asset.integrity == "suspect":
        trouble = "suspect_telemetry", f"{name} sends telemetry that cannot be right", 1.5
    if trouble is not None:
        kind, text, settle_s = trouble
        yield Cause("asset", kind, priority, asset.id, place, text, settle_s=settle_s)
        return
    if asset.task in ("returning", "charging") or not (asset.available or asset.stale):
        return
    if asset.low_battery:
        does = f"{asset.id} has a low battery and must return to base."
        if alone_at:
            relief = f"so {alone_at} needs a second guard: send one asset to {alone_at}."
            does = f"{asset.id} has a low battery, {relief}"
        yield Cause(
            "battery", "low_battery", "medium" if alone_at else "low", asset.id, place,
            text=f"{name} has a low battery, {asset.battery_pct:.0f} %",
            command=does,
            settle_s=2.0,
            raises=not asset.stale,
        )  # fmt: skip


def almost_low(picture: Picture, world: World) -> Iterator[tuple[AlarmTopic, str]]:
    """Yield the keys of batteries near their limit, whose open alarms must not clear."""
    for asset in picture.assets.values():
        near = asset.battery_pct < world.low_battery_pct + BATTERY_MARGIN_PCT
        if near and asset.task not in ("returning", "charging") and asset.status != "failed":
            yield "battery", asset.id


def _cameras(picture: Picture, world: World) -> Iterator[Cause]:
    for name, camera in picture.cameras.items():
        silent_s = picture.time_s - camera.stamp_s
        if camera.works and silent_s <= world.link_lost_s:
            continue
        why = "is out" if not camera.works else f"has been silent for {silent_s:.0f} s"
        cover = picture.gates.get(camera.gate)
        yield Cause(
            "camera", "camera_lost", "low" if cover and cover.covered else "medium", name,
            camera.gate, text=f"the camera {name} at {camera.gate} {why}", settle_s=1.0,
        )  # fmt: skip


def _an(words: str) -> str:
    return f"An {words}" if words[0] in "aeiou" else f"A {words}"


Key = tuple[AlarmTopic, str]
AlarmChange = AlarmRaised | AlarmCleared
Sensors = tuple[str, ...]


@dataclass
class _WatchedCause:
    """A cause under observation.

    It has had its present kind since `since_s` and was last present at `seen_s`, both in simulated
    seconds. `sensors` are all sensors that have detected its track.
    """

    cause: Cause
    since_s: float
    seen_s: float
    alarm: Alarm | None = None
    sensors: Sensors = ()

    def counts_as(self, kind: AlarmKind, priority: AlarmPriority) -> "_Alike | None":
        """Return the limited group of an alarm with these values; None if it has no limit."""
        minor = priority in ("medium", "low")
        if self.cause.topic in OF_TRACKS:
            return _Alike(kind, minor, self.sensors)
        return _Alike(kind, minor) if minor else None


class _Alike(NamedTuple):
    """A group of alarms with a limit: same kind, minor or not, and for contacts same sensors."""

    kind: AlarmKind
    minor: bool
    sensors: Sensors | None = None
    """The sensors that report the contacts; None for alarms about something else."""

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
        """The sensors of each open alarm's contact; None for an alarm about something else."""
        return {
            entry.alarm.id: entry.sensors if key[0] in OF_TRACKS else None
            for key, entry in self._watched.items()
            if entry.alarm is not None
        }

    def acknowledge(self, alarm_id: str, by: str) -> AlarmAcknowledged:
        """Record that `by` has seen an open alarm; raises ValueError if it is not open."""
        known = [alarm.id for alarm in self.open]
        if alarm_id not in known:
            raise ValueError(f"no alarm {alarm_id!r} is open; open: {', '.join(known) or 'none'}")
        self.acknowledged.add(alarm_id)
        return AlarmAcknowledged(alarm_id=alarm_id, by=by)

    def look(self, picture: Picture) -> list[AlarmChange]:
        """Process a new picture; return the cleared alarms, then the raised ones by priority."""
        self._remember_guards(picture)
        shown = {cause.key: cause for cause in causes(picture, self.world, self._guards)}
        self._observe(shown, picture)
        raised = self._raise(picture.time_s)
        cleared = self._clear(picture.time_s, raised)
        return [*cleared, *raised]

    def _remember_guards(self, picture: Picture) -> None:
        """Record the assets last known for certain to cover each gate, until they leave it."""
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
                    known = before.sensors if before is not None else ()
                    sensors = _both(known, cause.sensors)
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
        """Raise alarms for settled causes, and again for a new kind or a higher priority."""
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
        """Keep one alarm open for each group of sensors whose further contacts get no alarms."""
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
        """Clear alarms whose cause is gone or superseded; forget causes that raised no alarm."""
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
        """Return the id of the alarm about a subject, the earlier one if it is still recorded."""
        known = self._ids.pop(key, "")
        if not known:
            self._numbered += 1
            known = f"A{self._numbered:03d}"
        self._ids[key] = known
        if len(self._ids) > MOST_IDS:
            del self._ids[next(iter(self._ids))]
        return known


def _settled(entry: _WatchedCause) -> bool:
    return entry.seen_s - entry.since_s >= entry.cause.settle_s - 1e-6


def _changed(alarm: Alarm, cause: Cause) -> bool:
    """Return whether the alarm must be raised again: its kind is new or its priority is higher."""
    worse = ALARM_PRIORITIES.index(cause.priority) < ALARM_PRIORITIES.index(alarm.priority)
    return cause.kind != alarm.kind or worse


def _both(some: Sensors, others: Sensors) -> Sensors:
    """Return the union of two groups of sensors, sorted."""
    return tuple(sorted({*some, *others}))


def _cause_order(cause: Cause) -> tuple[int, float, str, str, str]:
    distance = cause.distance_m if cause.distance_m is not None else float("inf")
    rank = ALARM_PRIORITIES.index(cause.priority)
    return rank, distance, cause.gate or "", cause.subject, cause.topic


def _open_order(alarm: Alarm) -> tuple[int, float, float, str, str]:
    distance = alarm.distance_m if alarm.distance_m is not None else float("inf")
    rank = ALARM_PRIORITIES.index(alarm.priority)
    return rank, distance, alarm.raised_s, alarm.gate or "", alarm.id
