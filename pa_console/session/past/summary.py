"""What one recorded session was about and how it ended, read from its log in one pass.

Of telemetry only the beginning of each line is read, so a log is summed up far faster than it is
opened for a replay.
"""

import re
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from pa_console.schema.events import event as ev
from pa_console.schema.mission import MissionStatus
from pa_console.session.log.chain import LogError, parse, read_lines

_TEXT = rb'"(?:[^"\\]|\\.)*"'
_HEAD = re.compile(
    rb'\{"seq":\d+,"t":"([^"\\]+)","tick":-?\d+,"session":' + _TEXT + rb',"mission":(?:null|('
    + _TEXT + rb')),"kind":"([a-z_]+)"'
)  # fmt: skip
_READ = frozenset((b"session_started", b"mission_received", b"mission_finished", b"session_ended"))

Ending = Literal["closed", "open", "damaged"]
"""How a log ends: with the end of its session, without it, or where it cannot be read on."""


@dataclass
class PastMission:
    """A mission of a recorded session; `status` is None when its end is not in the log."""

    id: str
    said: str
    by_alarm: bool = False
    standing: str = ""
    """The standing order that started it."""
    status: MissionStatus | None = None
    reason: str = ""

    @property
    def origin(self) -> str:
        """Who gave it if that was no operator, to be told before its words; '' for an operator."""
        started = f"by standing order {self.standing}: " if self.standing else ""
        return "by alarm: " if self.by_alarm else started


@dataclass
class SessionSummary:
    """One recorded session; `length_s` counts from its first record to its last."""

    log: Path
    session: str = ""
    started: datetime | None = None
    length_s: float = 0.0
    world: str = ""
    world_sha256: str = ""
    rules: str = ""
    model: str = ""
    scenario: str = ""
    seed: int = 0
    readonly: bool = False
    missions: list[PastMission] = field(default_factory=list[PastMission])
    ending: Ending = "open"
    reason: str = ""
    """Why the session ended, or where its log cannot be read on."""

    @property
    def title(self) -> str:
        """The first order of the operator, else the scenario, else the first alarm's mission."""
        own = (mission.said for mission in self.missions if not mission.origin)
        first = next(iter(self.missions), None)
        return next(own, "") or self.scenario or (first.said if first else "no mission")

    @property
    def outcomes(self) -> dict[str, int]:
        """How many missions ended in each way, by status; `open` are those without an end."""
        found: dict[str, int] = {}
        for mission in self.missions:
            status = mission.status or "open"
            found[status] = found.get(status, 0) + 1
        return found


def summarise(log: Path) -> SessionSummary:
    """Return what the session of `log` was about.

    Raises LogError when `log` is not the log of a session at all.
    """
    found = SessionSummary(log)
    missions: dict[str, PastMission] = {}
    try:
        for number, line in read_lines(log):
            head = _HEAD.match(line)
            if head is None:
                raise LogError(str(log), number, "not a record of a session log")
            _time(found, head[1])
            if head[3] in _READ:
                _take(found, missions, _event(log, number, line))
            elif found.ending == "closed" and head[3] not in {b"log_signed"}:
                found.ending, found.reason = "open", ""
    except LogError as error:
        if found.started is None or not found.session:
            raise
        found.ending, found.reason = "damaged", str(error)
    if not found.session:
        raise LogError(str(log), 1, "the log does not begin with the start of a session")
    found.missions = list(missions.values())
    return found


def _event(log: Path, number: int, line: bytes) -> ev.Event:
    try:
        return parse(line).event
    except ValueError as error:
        raise LogError(str(log), number, str(error)) from error


def _time(found: SessionSummary, text: bytes) -> None:
    try:
        t = datetime.fromisoformat(text.decode())
    except ValueError:
        return
    t = t if t.tzinfo is not None else t.replace(tzinfo=UTC)
    found.started = found.started or t
    found.length_s = max(found.length_s, (t - found.started).total_seconds())


def _take(found: SessionSummary, missions: dict[str, PastMission], event: ev.Event) -> None:
    match event.data:
        case ev.SessionStarted() as data:
            found.session, found.world, found.rules = data.session, data.world, data.rules
            found.world_sha256, found.model = data.world_sha256, data.model
            found.scenario, found.seed, found.readonly = data.scenario, data.seed, data.readonly
        case ev.MissionReceived(mission=mission):
            missions[mission.id] = PastMission(
                mission.id,
                mission.said,
                by_alarm=mission.source == "alarm",
                standing=mission.standing,
            )
        case ev.MissionFinished(status=status, reason=reason) if event.mission in missions:
            mission = missions[event.mission]
            mission.status, mission.reason = status, reason
        case ev.SessionEnded(reason=reason):
            found.ending, found.reason = "closed", reason
        case _:
            pass


def past_sessions(folder: Path, most: int | None = None) -> list[SessionSummary]:
    """Return the sessions whose logs are in `folder`, the newest first, at most `most` of them.

    Files that are no logs of a session are left out; a folder that does not exist has none.
    """
    found: list[SessionSummary] = []
    for log in newest_logs(folder):
        if most is not None and len(found) >= most:
            break
        try:
            found.append(summarise(log))
        except LogError:
            continue
    return found


def newest_logs(folder: Path) -> list[Path]:
    """Return the session logs in `folder`, the one that was written last first."""
    times: dict[Path, int] = {}
    for log in folder.glob("*.jsonl"):
        try:
            times[log] = log.stat().st_mtime_ns
        except OSError:
            continue
    return sorted(times, key=lambda log: (times[log], log.name), reverse=True)


def find_session(folder: Path, name: str) -> Path:
    """Return the log that `name` stands for: a file, a session's id, or the only one it begins.

    `last` is the newest. Raises ValueError for no session, and for several.
    """
    given = Path(name).expanduser()
    if given.is_file():
        return given
    logs = newest_logs(folder)
    if name == "last" and logs:
        return logs[0]
    exact = [log for log in logs if name in {log.stem, log.name}]
    found = exact or [log for log in logs if name and log.stem.startswith(name)]
    if len(found) == 1:
        return found[0]
    if found:
        names = ", ".join(sorted(log.stem for log in found)[:6])
        raise ValueError(f"“{name}” stands for {len(found)} sessions: {names}")
    raise ValueError(f"there is no session “{name}” in {folder}; pa-console sessions lists them")
