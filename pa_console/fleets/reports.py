"""Reports of assets and sensors, and the checks of their times.

A report is dated by its own time, but never later than its arrival. A report from the future, or
from before the last one, is discarded.
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
"""The largest accepted lead of a report's time, in seconds; beyond it, a clock is wrong."""

BEHIND_S = 10.0
"""The largest accepted age of detections, in real seconds; tracks show current detections."""

REPEAT_S = 10.0
"""The least time between two equal notices about one subject, in seconds."""

MOST_SUBJECTS = 1000
"""The largest number of separately counted notices; further ones are counted together."""


@dataclass(frozen=True)
class AssetReport:
    """An asset's report of its own state; the station computes its age from `sent`."""

    agent: str
    sent: datetime
    """The time of sending, with a time zone; the time of arrival if the asset has no clock."""
    position: Point
    """The position in metres, in the world's frame."""
    heading_deg: float
    """The heading in degrees: 0 is east, 90 is north."""
    speed_mps: float
    status: AssetStatus
    task: Task
    battery_pct: float | None
    """The charge in percent; None if it is not reported, which counts as low."""
    command_id: str | None = None
    """The id of the command that the asset carries out; None if there is none."""
    manual: bool = False
    """True while a person steers the asset. It is then not available and is sent only holds."""
    route: Sequence[Point] = ()
    """The remaining waypoints, in metres."""


@dataclass(frozen=True)
class ContactReport:
    """One detection of a vehicle or person outside the team.

    `signature` is the same in all detections of one contact. Without a `position`, the sensor only
    repeats earlier findings. `sigma_m` is the standard deviation along one axis, in metres.
    """

    signature: str
    kind: Literal["vehicle", "person"]
    position: Point | None
    sigma_m: float
    identity: Identity = "unknown"
    opinion: Intent = "unknown"
    noncombatants: bool = False
    warned_s: float | None = None
    """The seconds since the contact was warned; None if it was not."""
    emergency: bool = False
    """True if the contact is recognised as an emergency vehicle."""


@dataclass(frozen=True)
class SensorReport:
    """The detections of one sensor, an asset or a camera of the world."""

    sensor: str
    sent: datetime
    """The time of sending, with a time zone."""
    contacts: Sequence[ContactReport] = ()
    team: Mapping[str, Point] = field(default_factory=dict[str, Point])
    """The observed positions of the assets that the sensor recognises."""
    works: bool = True
    """False if the sensor is a camera that is out of order."""


class Notices:
    """The notices for the session log; equal notices are emitted once in REPEAT_S and counted."""

    def __init__(self) -> None:
        self._lines: list[IncidentHappened | Noticed] = []
        self._last: dict[tuple[str, str], float] = {}
        self._more: dict[tuple[str, str], int] = {}

    def add(self, event: IncidentHappened | Noticed) -> None:
        """Add `event` unchanged."""
        self._lines.append(event)

    def say(self, level: Level, subject: str, text: str, now_s: float, kind: str = "") -> None:
        """Add a notice at `now_s`, unless one of the same `kind` was added within REPEAT_S."""
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
    """The checks that decide whether a report is accepted; each refused report causes a notice."""

    def __init__(self, dt_s: float, say: Callable[[Level, str, str, str], None]) -> None:
        """Count ticks of `dt_s` seconds; pass notices to `say` (level, subject, text, kind)."""
        self._dt_s, self._say = dt_s, say
        self._latest: dict[str, datetime] = {}
        """The time of sending of the last accepted report of each asset."""

    def tick_of(
        self, sent: datetime, arrived: datetime, now: datetime, tick: int, rate: float = 1.0
    ) -> int | None:
        """Return the tick at the time `sent`, on a station's clock that is at `tick` now.

        Returns None if `sent` is in the future. `rate` is the number of seconds that pass on the
        robots' clock in one real second.
        """
        if (sent - arrived).total_seconds() > AHEAD_S:
            return None
        age_s = (now - sent).total_seconds() * rate
        return tick - max(0, math.ceil(age_s / self._dt_s))

    def ahead(self, name: str) -> None:
        """Emit a notice that the clock of `name` is ahead."""
        self._say("alarm", name, "its clock is ahead of ours: its reports are ignored", "ahead")

    def is_latest(self, name: str, sent: datetime) -> bool:
        """Return whether a report is not older than the last one of asset `name`, and record it."""
        if (latest := self._latest.get(name)) is not None and sent < latest:
            text = "its report is older than the one before: ignored"
            self._say("warning", name, text, "old")
            return False
        self._latest[name] = sent
        return True

    def is_recent(self, name: str, age_ticks: int, rate: float = 1.0) -> bool:
        """Return whether detections of `name` that are `age_ticks` old are recent enough."""
        age_s = age_ticks * self._dt_s
        if age_s > BEHIND_S * rate:
            text = f"its detections are {age_s:.0f} s old, or its clock is behind: set aside"
            self._say("alarm", name, text, "behind")
            return False
        return True
