"""Reports of assets and sensors, and which of them a station believes.

A report is dated by its own time, and never newer than its arrival; a report from the future or
from before the last one is discarded.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal

from pa_console.schema.base import Point
from pa_console.schema.events.event import IncidentHappened, Level, Noticed
from pa_console.schema.telemetry import AssetStatus, Identity, Intent, Task

AHEAD_S = 2.0
"""A message that claims to be from so far in the future comes from a wrong clock."""

BEHIND_S = 10.0
"""Older detections, in real seconds, are set aside: a track is of what sensors see now."""


@dataclass(frozen=True)
class AssetReport:
    """An asset's report of itself; the station concludes from `sent` how old that is."""

    agent: str
    sent: datetime
    """When the asset sent it, with a time zone; the arrival for an asset without a clock."""
    position: Point
    """Metres in the world's frame."""
    heading_deg: float
    """0 east, 90 north."""
    speed_mps: float
    status: AssetStatus
    task: Task
    battery_pct: float | None
    """None while it is not reported: then it counts as low."""
    command_id: str | None = None
    """The command that it carries out, None for none."""
    manual: bool = False
    """True while a person steers it: it is not available, and only holds are sent to it."""
    route: Sequence[Point] = ()
    """Waypoints still ahead, metres."""


@dataclass(frozen=True)
class ContactReport:
    """One detection of a vehicle or person that is not ours.

    `signature` is the same for all detections of one contact. Without a `position` the sensor only
    repeats earlier findings; `sigma_m` is the error of one axis, metres.
    """

    signature: str
    kind: Literal["vehicle", "person"]
    position: Point | None
    sigma_m: float
    identity: Identity = "unknown"
    opinion: Intent = "unknown"
    noncombatants: bool = False
    warned_s: float | None = None
    """Seconds since the contact was warned, None if it was not."""
    emergency: bool = False
    """True if it is seen to be an emergency vehicle."""


@dataclass(frozen=True)
class SensorReport:
    """The detections of one sensor, an asset or a camera of the world."""

    sensor: str
    sent: datetime
    """When the sensor sent it, with a time zone."""
    contacts: Sequence[ContactReport] = ()
    team: Mapping[str, Point] = field(default_factory=dict[str, Point])
    """The assets that it recognises, each with the place where it sees it."""
    works: bool = True
    """False for a camera that is out of order."""


REPEAT_S = 10.0
MOST_SUBJECTS = 1000


class Notices:
    """Collects lines for the session log; a subject's repeated line appears once in REPEAT_S."""

    def __init__(self) -> None:
        self._lines: list[IncidentHappened | Noticed] = []
        self._last: dict[tuple[str, str], float] = {}
        self._more: dict[tuple[str, str], int] = {}

    def add(self, event: IncidentHappened | Noticed) -> None:
        """Add `event` as it is."""
        self._lines.append(event)

    def say(self, level: Level, subject: str, text: str, now_s: float, kind: str = "") -> None:
        """Add a notice at `now_s`, unless one of the same `kind` was added just now."""
        key = (subject, kind or text)
        if key not in self._last and len(self._last) >= MOST_SUBJECTS:
            key = ("", kind)
        last_s = self._last.get(key)
        if last_s is not None and now_s - last_s < REPEAT_S:
            self._more[key] = self._more.get(key, 0) + 1
            return
        more = self._more.pop(key, 0)
        self._last[key] = now_s
        since = f" (and {more} more like it)" if more else ""
        shown = "".join(c if c.isprintable() else " " for c in text[:500])
        self._lines.append(Noticed(level=level, subject=subject[:64], text=f"{shown}{since}"))

    def take(self) -> tuple[IncidentHappened | Noticed, ...]:
        """Return the notices since the last call."""
        lines, self._lines = self._lines, []
        return tuple(lines)


class Belief:
    """Decides which reports are believed, and emits a notice about each that is not."""

    def __init__(self, dt_s: float, say: Callable[[Level, str, str, str], None]) -> None:
        """`dt_s` is the station's step in seconds; `say` takes level, subject, text and kind."""
        self._dt_s, self._say = dt_s, say
        self._latest: dict[str, datetime] = {}
        """When the report of each asset that was believed last was sent."""

    def tick_of(
        self, sent: datetime, arrived: datetime, now: datetime, tick: int, rate: float = 1.0
    ) -> int | None:
        """Return the tick of `sent` on a station's clock that is at `tick`; None for the future.

        `rate` is the number of seconds on the robots' clock that pass in one.
        """
        if (sent - arrived).total_seconds() > AHEAD_S:
            return None
        age_s = (now - sent).total_seconds() * rate
        return tick - max(0, math.ceil(age_s / self._dt_s))

    def ahead(self, name: str) -> None:
        """Emit that the clock of `name` is ahead."""
        self._say(
            "alarm", name, "its clock is ahead of ours: what it reports is not believed", "ahead"
        )

    def is_latest(self, name: str, sent: datetime) -> bool:
        """Return whether no later report of asset `name` was believed before; it is noted."""
        if (latest := self._latest.get(name)) is not None and sent < latest:
            text = "its state is older than the one before: not believed"
            self._say("warning", name, text, "old")
            return False
        self._latest[name] = sent
        return True

    def is_recent(self, name: str, age_ticks: int, rate: float = 1.0) -> bool:
        """Return whether detections of `name` that are `age_ticks` old still count."""
        age_s = age_ticks * self._dt_s
        if age_s > BEHIND_S * rate:
            text = f"its detections are {age_s:.0f} s old, or its clock is behind: set aside"
            self._say("alarm", name, text, "behind")
            return False
        return True
