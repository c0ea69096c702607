"""The index of the sessions in a folder of logs, which reveals a deleted or shortened log.

`sessions.index` has a line for each session that began, with the hash of its first record, and one
for each session that ended, with the hash of its last record. Each line is signed and has the
SHA-256 of the previous line, so a removed line leaves a gap. A copy of the last line is kept beside
the signing key, so an attacker who can only change the folder cannot shorten the index unnoticed.
"""

import fcntl
import hashlib
import json
import os
import time
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, cast

from pa_console.private_files import (
    make_private_folder,
    open_private,
    replace_private,
    sync_folder,
    write_all,
)
from pa_console.schema.base import Hex32
from pa_console.session.log.chain import GENESIS, LINE_LIMIT, encodable, os_error
from pa_console.signing import SignedLine, Signer, fingerprint, key_path

INDEX_NAME = "sessions.index"
LOCK_S, LOCK_STEP_S = 5.0, 0.01
"""The seconds to wait while another console writes its line, and the seconds between attempts."""
_CHUNK = 1 << 20


class IndexLine(SignedLine):
    """A statement signed by `key`: record number `records` of `log` exists and has `hash`.

    If the session has `ended`, the log has no further records. `seq` is the number of the line, and
    `prev` is the hash of the previous line.
    """

    PURPOSE: ClassVar = b"pa-console index of sessions, line\n"
    TITLE: ClassVar = "a line of an index of sessions"

    ended: bool
    hash: Hex32
    log: str
    prev: Hex32
    records: int
    seq: int
    session: str


def index_path(folder: Path) -> Path:
    """Return the path of the index of the logs in `folder`."""
    return folder / INDEX_NAME


def anchor_path(folder: Path) -> Path:
    """Return the path of the copy of the index's last line, beside the signing key."""
    name = hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:32]
    return key_path().parent / "session-indexes" / name


class SessionIndex:
    """A writer of lines to the index in the folder of a console's log."""

    def __init__(self, folder: Path, signer: Signer) -> None:
        self._folder, self._signer = folder, signer

    def add(self, log: str, session: str, records: int, head: str, *, ended: bool) -> None:
        """Add a line: `log` has `records` records, and the last of them has the hash `head`.

        The new line refers to the last line that this machine wrote, even if that line is gone, so
        that the gap stays visible. Raises OSError if the index cannot be written.
        """
        index, anchor = index_path(self._folder), anchor_path(self._folder)
        make_private_folder(anchor.parent)
        file = open_private(index, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        try:
            _lock(file)
            with open(file, "rb", closefd=False) as stream:
                content = stream.read()
            lines, torn = _whole_lines(content)
            if torn:
                self._set_aside(torn)
                os.ftruncate(file, len(content) - len(torn))
            seq, prev = _end(lines, read_anchor(self._folder))
            line = IndexLine.signed(
                self._signer,
                ended=ended,
                hash=head,
                log=log,
                prev=prev,
                records=records,
                seq=seq + 1,
                session=encodable(session),
            ).line
            write_all(file, line)
            # The line must be on the disk before its anchor; otherwise, after a crash, the index
            # would look shortened.
            os.fsync(file)
            replace_private(anchor, line)
            with suppress(OSError):
                sync_folder(self._folder)
        finally:
            os.close(file)

    def _set_aside(self, torn: bytes) -> None:
        """Append an incomplete line left by a crash to a file beside the index."""
        aside = self._folder / f"{INDEX_NAME}.torn"
        with os.fdopen(open_private(aside, os.O_WRONLY | os.O_CREAT | os.O_APPEND), "ab") as stream:
            stream.write(torn + b"\n")


def _whole_lines(content: bytes) -> tuple[list[bytes], bytes]:
    """Return the complete lines of an index, and the incomplete last line, if any.

    An incomplete line was never anchored, because power failed while it was written.
    """
    end = content.rfind(b"\n") + 1
    return content[:end].splitlines(keepends=True), content[end:]


def line_hash(line: bytes) -> str:
    """Return the hash of `line`, which the next line contains."""
    return hashlib.sha256(line).hexdigest()


def read_anchor(folder: Path) -> bytes:
    """Return the anchor: the last line that this machine wrote to the index of `folder`, or b""."""
    try:
        return anchor_path(folder).read_bytes()
    except FileNotFoundError:
        return b""


def _end(lines: list[bytes], anchor: bytes) -> tuple[int, str]:
    """Return the number and the hash of the line that the next line must follow."""
    last = lines[-1] if lines else b""
    records = _number(last) if last else 0
    kept = _number(anchor) if anchor else 0
    # If the index was shortened, the new line follows the anchor, so that a gap remains.
    if kept > records or (kept == records and last != anchor):
        return kept, line_hash(anchor)
    return (records or len(lines), line_hash(last)) if last else (0, GENESIS)


def _number(line: bytes) -> int:
    """Return the number of a line, or 0 if the line is not valid."""
    try:
        return IndexLine.parse(line).seq
    except ValueError:
        return 0


def _lock(file: int) -> None:
    """Lock the index, waiting for other consoles; raises BlockingIOError after LOCK_S."""
    for _ in range(round(LOCK_S / LOCK_STEP_S)):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(LOCK_STEP_S)
        else:
            return
    raise BlockingIOError("another program holds the index of sessions")


@dataclass(frozen=True)
class IndexedSession:
    """A session in the index; `problem` is the damage to its log, or '' without damage."""

    log: str
    session: str
    ended: bool
    problem: str = ""


@dataclass(frozen=True)
class IndexReport:
    """The sessions of an index in order, and the problems of the index itself.

    `copies` are logs in the folder that repeat the log of an indexed session under another name.
    """

    sessions: tuple[IndexedSession, ...] = ()
    problems: tuple[str, ...] = ()
    copies: tuple[IndexedSession, ...] = ()

    @property
    def all_problems(self) -> tuple[str, ...]:
        """The problems of the index and of the logs, one sentence each."""
        logs = (f"{status.log}: {status.problem}" for status in self._logs if status.problem)
        return (*self.problems, *logs)

    def of(self, log: Path) -> str:
        """Return the problem that the index reveals in `log`; '' if there is none."""
        problems = (status.problem for status in self._logs if status.log == log.name)
        return next(filter(None, problems), "")

    @property
    def _logs(self) -> tuple[IndexedSession, ...]:
        return (*self.sessions, *self.copies)


def check_index(folder: Path, accepted: Collection[str]) -> IndexReport:
    """Check the index of `folder`, and the first and the last record of every log in it.

    Lines count only if they are signed by keys whose fingerprints are `accepted`. Raises LogError
    if a file cannot be read.
    """
    path = index_path(folder)
    try:
        content = path.read_bytes()
        anchor = read_anchor(folder)
    except FileNotFoundError:
        content, anchor = b"", read_anchor(folder)
    except OSError as error:
        raise os_error(path, "read the index of sessions", error) from error
    entries: list[IndexLine] = []
    problems = list(_chain(path.name, content, accepted, entries))
    if anchor and anchor not in content.splitlines(keepends=True):
        problems.append(f"{path.name}: its last line that this machine wrote is gone")
    sessions, copies = _sessions(folder, entries), _copies(folder, entries)
    return IndexReport(tuple(sessions), tuple(problems), tuple(copies))


def _chain(
    name: str, content: bytes, accepted: Collection[str], entries: list[IndexLine]
) -> Iterator[str]:
    """Check every line; add the accepted lines to `entries`, and yield the problems."""
    seq, prev, sound = 0, GENESIS, True
    for number, line in enumerate(_whole_lines(content)[0], start=1):
        try:
            entry = IndexLine.parse(line)
        except ValueError as error:
            yield f"{name}:{number}: {error}"
            sound = False
            continue
        if sound and entry.seq != seq + 1:
            yield f"{name}:{number}: lines {seq + 1} to {entry.seq - 1} of the index are gone"
        elif sound and entry.prev != prev:
            yield f"{name}:{number}: the line before it was replaced"
        seq, prev, sound = entry.seq, line_hash(line), True
        if (key := fingerprint(entry.key)) in accepted:
            entries.append(entry)
        else:
            yield f"{name}:{number}: signed by an unknown key, {key}"


def _sessions(folder: Path, entries: list[IndexLine]) -> Iterator[IndexedSession]:
    by_log: dict[tuple[str, str], list[IndexLine]] = {}
    for entry in entries:
        by_log.setdefault((entry.log, entry.session), []).append(entry)
    for (log, session), lines in by_log.items():
        ended = any(line.ended for line in lines)
        yield IndexedSession(log, session, ended, _problem(folder / log, session, lines))


def _copies(folder: Path, entries: list[IndexLine]) -> Iterator[IndexedSession]:
    """Yield the logs that are not in the index but have the first record of a log that is."""
    begun = {entry.hash: entry for entry in entries if entry.records == 1}
    names = {entry.log for entry in entries}
    if not begun:
        return
    for path in sorted(folder.glob("*.jsonl")):
        if path.name in names or not path.is_file():
            continue
        entry = begun.get(str(_first(path).get("hash")))
        if entry is not None:
            problem = f"a copy of {entry.log}, the log of session {entry.session}"
            yield IndexedSession(path.name, entry.session, ended=False, problem=problem)


def _problem(log: Path, session: str, lines: list[IndexLine]) -> str:
    """Return how `log` differs from its `lines` in the index; '' if it does not differ."""
    if log.name != lines[0].log or not log.is_file():
        return f"the log of session {session} is missing"
    try:
        first, last = _ends(log)
    except OSError as error:
        raise os_error(log, "read the session log", error) from error
    records = last.get("seq", 0)
    for entry in lines:
        if entry.records > records:
            ended = "ended with" if entry.ended else "had"
            return (
                f"cut short: session {session} {ended} {entry.records} records, {records} are left"
            )
        if entry.records in (1, records):
            record = first if entry.records == 1 else last
            if (record.get("hash"), record.get("session")) != (entry.hash, entry.session):
                return f"record {entry.records} is not the one that session {session} had"
    return ""


def _ends(log: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the first and the last complete line of `log` as records; {} for an invalid line."""
    with log.open("rb") as file:
        first = file.readline()
        at, tail = file.seek(0, 2), b""
        while at and tail.count(b"\n") < 2:
            start = max(0, at - _CHUNK)
            file.seek(start)
            tail = file.read(at - start) + tail
            at = start
    lines = tail[: tail.rfind(b"\n") + 1].splitlines()
    return _record(first), _record(lines[-1] if lines else b"")


def _first(log: Path) -> dict[str, Any]:
    """Return the first record of `log`, or {} if it is invalid or cannot be read."""
    try:
        with log.open("rb") as file:
            return _record(file.readline(LINE_LIMIT))
    except OSError:
        return {}


def _record(line: bytes) -> dict[str, Any]:
    try:
        value: object = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(value, dict):
        return {}
    record = cast(dict[str, Any], value)
    return record if isinstance(record.get("seq", 0), int) else {}
