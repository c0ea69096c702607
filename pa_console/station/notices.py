"""Notices for the operator's event list, derived from successive pictures.

A change is shown when it has lasted for a while. If many assets change in the same way at once, one
line is shown. Reports from outside the site's sensors are shown too, and have no other effect.
"""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Protocol, get_args

from pa_console.mission.planning.picture_text import silence
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import Level, Noticed
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Track

MOST_ALIKE = 4
MANUAL = "manual control"
GONE_S = 3.0
Value = str | bool
Key = tuple[str, str]
"""A subject and one of its properties."""
LOOK_S = 0.5
"""The interval between two requests for reports, in seconds of wall time."""
_ADMITTED = get_args(ev.OutsideReport)


@dataclass(frozen=True, slots=True)
class _Fact:
    """A property of a subject; `text` is the line for a change to this value, or '' for no line.

    A value is shown when it has differed from the last shown value for `settle_s` simulated
    seconds. For a new subject, `at_first` counts as the last shown value.
    """

    subject: str
    topic: str
    value: Value
    at_first: Value | None
    level: Level
    text: str
    settle_s: float = 0.0


class Noticer:
    """A source of notices, derived from pictures; equal pictures give equal notices."""

    def __init__(self, picture: Picture) -> None:
        """Treat everything in `picture` as already reported."""
        self._values: dict[Key, Value | None] = {
            (fact.subject, fact.topic): fact.value for fact in _facts(picture)
        }
        self._since: dict[Key, tuple[Value, float]] = {}
        self._tracks: dict[str, float] = dict.fromkeys(picture.tracks, picture.time_s)

    def knows_manual(self, asset: str, *, manual: bool) -> None:
        """Treat the manual control of `asset`, or its end, as already reported."""
        self._values[asset, MANUAL] = manual

    def look(self, picture: Picture) -> list[Noticed]:
        """Return the notices about changes that the operator should see now."""
        now_s = picture.time_s
        news = [fact for fact in _facts(picture) if self._is_news(fact, now_s)]
        facts = [fact for fact in news if fact.text]
        return [*_grouped(facts), *self._gone(picture)]

    def _is_news(self, fact: _Fact, now_s: float) -> bool:
        key = (fact.subject, fact.topic)
        if self._values.setdefault(key, fact.at_first) == fact.value:
            self._since.pop(key, None)
            return False
        value, since_s = self._since.get(key, (fact.value, now_s))
        if value != fact.value:
            since_s = now_s
        if now_s - since_s < fact.settle_s:
            self._since[key] = (fact.value, since_s)
            return False
        self._since.pop(key, None)
        self._values[key] = fact.value
        return True

    def _gone(self, picture: Picture) -> Iterator[Noticed]:
        """Yield a notice for each track that is missing for GONE_S, and forget the track."""
        self._tracks.update(dict.fromkeys(picture.tracks, picture.time_s))
        for name, seen_s in list(self._tracks.items()):
            if name not in picture.tracks and picture.time_s - seen_s >= GONE_S:
                del self._tracks[name]
                keys = [key for key in self._values if key[0] == name]
                if self._values.get((name, "presence")) is not None:
                    yield Noticed(level="info", subject=name, text="track is gone")
                for key in keys:
                    del self._values[key]
                    self._since.pop(key, None)


def _facts(picture: Picture) -> Iterator[_Fact]:
    for gate, cover in picture.gates.items():
        yield _gate(picture, gate, cover)
    for asset in picture.assets.values():
        yield from _asset(picture, asset)
    for name, camera in picture.cameras.items():
        works = "works again" if camera.works else "is out"
        level = "info" if camera.works else "warning"
        text = f"camera at {camera.gate} {works}"
        yield _Fact(name, "camera", camera.works, True, level, text, 1.0)
    for track in picture.tracks.values():
        yield from _track(picture, track)
    weather = picture.weather
    yield _Fact("weather", "weather", weather, "clear", "info", f"{weather} from now on")


def _gate(picture: Picture, gate: str, cover: GateCover) -> _Fact:
    if cover.covered:
        return _Fact(gate, "cover", "covered", None, "info", f"covered by {', '.join(cover.by)}")
    if not cover.unknown:
        return _Fact(gate, "cover", "none", None, "alarm", "no longer covered", 1.0)
    unsure = [picture.assets[name] for name in cover.unsure if name in picture.assets]
    why = [why for asset in unsure if (why := silence(picture, asset))]
    text = ", ".join(["cover unknown", *why])
    return _Fact(gate, "cover", "unknown", None, "warning", text, 1.0)


def _asset(picture: Picture, asset: AssetTelemetry) -> Iterator[_Fact]:
    """Yield the facts about an asset: its status, battery, manual control, link and integrity."""
    name, status = asset.id, asset.status
    if status == "degraded" and (asset.low_battery or asset.comms != "ok"):
        status = "ok"  # the reason has its own notice
    level: Level = "alarm" if status == "failed" else "info"
    settle_s = 0.0 if status == "failed" else 3.0
    yield _Fact(name, "status", status, status, level, f"status {status}", settle_s)
    low = f"battery low, {asset.battery_pct:.0f} %" if asset.low_battery else ""
    settle_s = 1.0 if low else 20.0
    yield _Fact(name, "battery", asset.low_battery, False, "warning", low, settle_s)
    driven = "under manual control" if asset.manual else "no longer under manual control"
    yield _Fact(name, MANUAL, asset.manual, False, "warning", driven)
    age_s = picture.time_s - asset.stamp_s
    if asset.integrity == "suspect":
        fact = "suspect", "warning", "telemetry is suspect: it cannot be right", 1.0
    elif asset.comms == "lost":
        fact = "lost", "warning", f"communications lost, silent for {age_s:.0f} s", 0.0
    elif asset.stale:
        fact = "stale", "warning", f"silent for {age_s:.0f} s", 2.0
    elif asset.comms == "degraded":
        fact = "degraded", "info", "communications degraded", 5.0
    else:
        fact = "ok", "info", "communications ok", 5.0
    value, level, text, settle_s = fact
    yield _Fact(name, "heard", value, "ok", level, text, settle_s)


def _track(picture: Picture, track: Track) -> Iterator[_Fact]:
    """Yield the facts about a track: its presence, identity and behaviour."""
    name = track.id
    words = f"{track.identity} {track.kind} {track.status}, {track.gate}, {track.distance_m:.0f} m"
    yield _Fact(name, "presence", True, None, "alarm", words)
    seen = "observed by a UAV" if track.observed else ""
    yield _Fact(name, "observed", track.observed, False, "info", seen)
    text = f"identified as {track.identity}" if track.identity != "unknown" else "identity unknown"
    yield _Fact(name, "identity", track.identity, track.identity, "warning", text)
    dispute = f"{track.dispute}; have another robot identify it" if track.dispute else ""
    yield _Fact(name, "dispute", track.dispute, "", "warning", dispute)
    hostile = track.intent == "hostile"
    by = f", {' and '.join(track.hostile_by)} say so" if hostile and track.hostile_by else ""
    level: Level = "alarm" if hostile else "info"
    yield _Fact(name, "intent", track.intent, "unknown", level, f"intent {track.intent}{by}")
    yield _Fact(name, "warned", track.warned, False, "info", "warned" if track.warned else "")
    defiant = "goes on in spite of the warning" if track.defiant else ""
    yield _Fact(name, "defiant", track.defiant, False, "alarm", defiant)
    marked = "it is an emergency vehicle" if track.emergency else ""
    yield _Fact(name, "emergency", track.emergency, False, "warning", marked)
    persons = "noncombatants are suspected" if track.noncombatants else ""
    yield _Fact(name, "persons", track.noncombatants, False, "warning", persons)
    moves = f"{track.status} at {track.gate}"
    yield _Fact(name, "status", track.status, track.status, "info", moves, 1.0)
    age_s = picture.time_s - track.stamp_s
    sight = f"not seen for {age_s:.0f} s" if track.stale else f"seen again at {track.gate}"
    yield _Fact(name, "sight", track.stale, False, "info", sight, 1.0)


def _grouped(facts: list[_Fact]) -> Iterator[Noticed]:
    """Yield one line for each fact, or one line for many subjects with the same change."""

    def kind(fact: _Fact) -> tuple[str, str]:
        return fact.topic, str(fact.value)

    order = {kind(fact): index for index, fact in reversed(list(enumerate(facts)))}
    for _, group in groupby(sorted(facts, key=lambda f: order[kind(f)]), key=kind):
        alike = list(group)
        if len(alike) <= MOST_ALIKE:
            for fact in alike:
                yield Noticed(level=fact.level, subject=fact.subject, text=fact.text)
            continue
        first, *others = alike
        named = ", ".join(fact.subject for fact in others[: MOST_ALIKE - 1])
        text = f"{first.text}; likewise {len(others)} others, among them {named}"
        yield Noticed(level=first.level, subject=first.subject, text=text)


class Outside(Protocol):
    """A source of reports."""

    def news(self) -> Sequence[ev.OutsideReport]:
        """Return the reports since the last call; must return at once, with only a few reports."""
        ...


async def pass_on(outside: Outside, emit: Callable[[ev.OutsideReport], None]) -> None:
    """Emit the reports of a source until the session ends; values of other types are ignored.

    If the source fails, a notice is emitted, and the session continues without the source.
    """
    while True:
        try:
            reports = [report for report in outside.news() if isinstance(report, _ADMITTED)]
        except Exception as error:  # an outside report must not end the session
            text = f"no more reports from outside are read: {type(error).__name__}: {error}"
            emit(ev.Noticed(level="warning", subject="TAK", text=text))
            return
        for report in reports:
            emit(report)
        await asyncio.sleep(LOOK_S)
