"""Recorded sessions: their summaries, their soundness, and a search by name.

For a summary, the log is read in one pass, and of most lines only the start is parsed. This is far
faster than opening the log for a replay.
"""

import fcntl
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal

from pa_console.schema.events import event as ev
from pa_console.schema.mission import MissionStatus
from pa_console.session.log.chain import RECORD_START, LogError, parse, read_lines
from pa_console.session.log.verification import verify
from pa_console.session.state import SessionState

_READ = frozenset((b"session_started", b"mission_received", b"mission_finished", b"session_ended"))
_PICTURES = frozenset((b"telemetry", b"log_signed"))

Ending = Literal["closed", "open", "damaged"]
"""How a log ends: with the end of its session, without it, or at damage."""
LogStanding = Literal["verified", "running", "open", "unsigned", "damaged"]


@dataclass
class RecordedMission:
    """A mission of a recorded session; `status` is None if the mission's end is not in the log."""

    id: str
    said: str
    by_alarm: bool = False
    standing: str = ""
    """The id of the standing order that started the mission; '' if none did."""
    status: MissionStatus | None = None
    reason: str = ""

    @property
    def origin(self) -> str:
        """The source of the mission, shown before its text; '' for an operator."""
        started = f"by standing order {self.standing}: " if self.standing else ""
        return "by alarm: " if self.by_alarm else started


@dataclass
class SessionSummary:
    """One recorded session; `length_s` is the time from its first record to its last."""

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
    missions: list[RecordedMission] = field(default_factory=list[RecordedMission])
    ending: Ending = "open"
    reason: str = ""
    """The reason of the end, or the damage to the log."""

    @property
    def title(self) -> str:
        """The operator's first order, else the scenario, else the first mission."""
        own = (mission.said for mission in self.missions if not mission.origin)
        first = next(iter(self.missions), None)
        return next(own, "") or self.scenario or (first.said if first else "no mission")

    @property
    def outcomes(self) -> dict[str, int]:
        """The number of missions by final status; missions without an end count as `open`."""
        return Counter(mission.status or "open" for mission in self.missions)

    @property
    def local_start(self) -> str:
        """The start of the session in local time; '' if it is unknown."""
        return f"{self.started.astimezone():%Y-%m-%d %H:%M:%S}" if self.started else ""


def summarise(log: Path) -> SessionSummary:
    """Return the summary of `log`; raises LogError if it is not the log of a session."""
    summary = SessionSummary(log)
    missions: dict[str, RecordedMission] = {}
    try:
        for number, line in read_lines(log):
            head = RECORD_START.match(line)
            if head is None:
                raise LogError(str(log), number, "not a record of a session log")
            _time(summary, head[1])
            if head[3] in _READ:
                _take(summary, missions, _event(log, number, line))
            elif summary.ending == "closed" and head[3] not in {b"log_signed"}:
                summary.ending, summary.reason = "open", ""
    except LogError as error:
        if summary.started is None or not summary.session:
            raise
        summary.ending, summary.reason = "damaged", str(error)
    if not summary.session:
        raise LogError(str(log), 1, "the log does not begin with the start of a session")
    summary.missions = list(missions.values())
    return summary


def _event(log: Path, number: int, line: bytes) -> ev.Event:
    try:
        return parse(line).event
    except ValueError as error:
        raise LogError(str(log), number, str(error)) from error


def _time(summary: SessionSummary, text: bytes) -> None:
    try:
        t = datetime.fromisoformat(text.decode())
    except ValueError:
        return
    t = t if t.tzinfo is not None else t.replace(tzinfo=UTC)
    summary.started = summary.started or t
    summary.length_s = max(summary.length_s, (t - summary.started).total_seconds())


def _take(summary: SessionSummary, missions: dict[str, RecordedMission], event: ev.Event) -> None:
    match event.data:
        case ev.SessionStarted() as data:
            summary.session, summary.world, summary.rules = data.session, data.world, data.rules
            summary.world_sha256, summary.model = data.world_sha256, data.model
            summary.scenario, summary.seed, summary.readonly = (
                data.scenario,
                data.seed,
                data.readonly,
            )
        case ev.MissionReceived(mission=mission):
            missions[mission.id] = RecordedMission(
                mission.id,
                mission.said,
                by_alarm=mission.source == "alarm",
                standing=mission.standing,
            )
        case ev.MissionFinished(status=status, reason=reason) if event.mission in missions:
            mission = missions[event.mission]
            mission.status, mission.reason = status, reason
        case ev.SessionEnded(reason=reason):
            summary.ending, summary.reason = "closed", reason
        case _:
            pass


def fold_decisions(log: Path, world_sha256: str) -> tuple[SessionState | None, datetime | None]:
    """Return the state at the end of `log`, without its picture, and the time of the log's end.

    Returns None for both if the session is read-only or of another world. Raises LogError if the
    file is not a session log.
    """
    state, last = SessionState(), SessionSummary(log)
    for number, line in read_lines(log):
        head = RECORD_START.match(line)
        if head is None:
            raise LogError(str(log), number, "not a record of a session log")
        _time(last, head[1])
        if head[3] in _PICTURES:
            continue
        event = _event(log, number, line)
        if isinstance(event.data, ev.SessionStarted) and (
            event.data.world_sha256 != world_sha256 or event.data.readonly
        ):
            return None, None
        state.apply(event)
    ended = last.started + timedelta(seconds=last.length_s) if last.started else None
    return state, ended


def past_sessions(folder: Path, most: int | None = None) -> list[SessionSummary]:
    """Return the sessions with logs in `folder`, newest first, at most `most` of them.

    Files that are not session logs are ignored. A missing folder counts as empty.
    """
    sessions: list[SessionSummary] = []
    for log in newest_logs(folder):
        if most is not None and len(sessions) >= most:
            break
        try:
            sessions.append(summarise(log))
        except LogError:
            continue
    return sessions


def newest_logs(folder: Path) -> list[Path]:
    """Return the session logs in `folder`, the most recently changed first."""
    times: dict[Path, int] = {}
    for log in folder.glob("*.jsonl"):
        try:
            times[log] = log.stat().st_mtime_ns
        except OSError:
            continue
    return sorted(times, key=lambda log: (times[log], log.name), reverse=True)


def find_session(folder: Path, name: str) -> Path:
    """Return the log for `name`: a file, a log's name, or a unique beginning of a log's name.

    `last` means the newest session. Raises ValueError if no session or more than one matches.
    """
    given = Path(name).expanduser()
    if given.is_file():
        return given
    logs = newest_logs(folder)
    if name == "last" and logs:
        return logs[0]
    exact = [log for log in logs if name in {log.stem, log.name}]
    matches = exact or [log for log in logs if name and log.stem.startswith(name)]
    if len(matches) == 1:
        return matches[0]
    if matches:
        names = ", ".join(sorted(log.stem for log in matches)[:6])
        raise ValueError(f"“{name}” matches {len(matches)} sessions: {names}")
    raise ValueError(f"there is no session “{name}” in {folder}; pa-console sessions lists them")


@dataclass(frozen=True)
class Soundness:
    """The result of `pa-console replay LOG --verify --chain-only` in one word.

    `verified`: a known key has signed every line. `running`: a console is writing the log. `open`:
    undamaged, but never closed. `unsigned`: undamaged, but not signed. `damaged`: changed or
    unreadable, with the place in `detail`.
    """

    standing: LogStanding
    detail: str = ""


def is_held(log: Path) -> bool:
    """Return True if a console is writing `log` now; raises OSError if it cannot be opened."""
    with log.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        fcntl.flock(file, fcntl.LOCK_UN)
    return False


def soundness(log: Path) -> Soundness:
    """Check chain, signatures and head of `log`; only keys of this machine are accepted."""
    try:
        running = is_held(log)
        result = verify(log)
    except LogError as error:
        return Soundness("damaged", str(error))
    except OSError as error:
        return Soundness("damaged", f"{log}: {error.strerror or error}")
    if not result.ok and not running:
        line = f"line {result.first_bad_line}: " if result.first_bad_line else ""
        return Soundness("damaged", f"{line}{result.damage}: {result.problem}")
    if running:
        return Soundness("running", "a console is writing this log")
    if result.intact:
        return Soundness("verified", f"every line is signed by {result.key}")
    return Soundness("open" if result.standing == "open" else "unsigned", result.note)
