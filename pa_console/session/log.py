"""Writes the session log: hash-chained JSONL, one record a line, as it happens."""

import fcntl
import os
import re
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

import platformdirs

from pa_console.schema.event import Event
from pa_console.session.chain import (
    GENESIS,
    LogError,
    Record,
    os_error,
    own_problem,
    parse,
    seal,
)
from pa_console.session.reader import VerifyResult, read_log, verify

__all__ = [
    "LogError",
    "LogWriter",
    "VerifyResult",
    "default_folder",
    "new_log_path",
    "read_log",
    "verify",
]

FLUSH_RECORDS = 50
FLUSH_SECONDS = 1.0
DURABLE_KINDS = frozenset(
    (
        "session_started", "incident", "mission_received", "decision_made", "plan_voided",
        "command_sent", "mission_finished", "all_stopped", "session_ended",
    )
)  # fmt: skip
"""Events that are on the disk before `append` returns: what an operator answers for."""


def default_folder() -> Path:
    """Return the folder of the user's session logs; it may not exist yet."""
    return platformdirs.user_state_path("pa-console") / "sessions"


def new_log_path(folder: Path, session: str) -> Path:
    """Create an empty log for `session` in `folder` under a name that no other console has.

    Raises LogError when the folder cannot be written to.
    """
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", session).strip("._") or "session"
    path, number = folder / f"{stem}.jsonl", 1
    try:
        folder.mkdir(parents=True, exist_ok=True)
        while True:
            try:
                path.open("xb").close()
            except FileExistsError:
                number += 1
                path = folder / f"{stem}-{number}.jsonl"
            else:
                return path
    except OSError as error:
        raise os_error(path, "create the session log", error) from error


class LogWriter:
    """Appends events to a log that it alone holds; not for use by several threads.

    Records are written at least every FLUSH_RECORDS records or FLUSH_SECONDS seconds, and are
    safe on the disk at once for DURABLE_KINDS. When the disk refuses, the records are kept in
    memory and written as soon as it takes them again; `on_error` is told once each time that
    begins. Without `on_error` the LogError is raised from `append` or `flush` instead, and the
    event is kept all the same.
    """

    def __init__(
        self,
        path: Path,
        session: str,
        *,
        on_error: Callable[[LogError], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open `path`, new or to be continued; a torn last line moves to `PATH.torn`.

        Raises LogError when the file cannot be opened, is held by another console, belongs to
        another session or does not end in a sound record.
        """
        self.path, self.session = path, session
        self.error: LogError | None = None
        self._on_error, self._clock = on_error, clock
        self._seq, self._head = 0, GENESIS
        self._pending, self._records = bytearray(), 0
        self._flushed_at = clock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise os_error(path, "open the session log", error) from error
        try:
            self._lock()
            self._continue()
        except BaseException:
            os.close(self._file)
            raise
        self._open = True

    @property
    def lines(self) -> int:
        """Records appended so far, those of an earlier opening included."""
        return self._seq

    @property
    def head(self) -> str:
        """The hash of the last record: noted down elsewhere, it vouches for the whole log."""
        return self._head

    @property
    def unwritten(self) -> int:
        """Records that are in memory only."""
        return self._records

    def append(self, event: Event) -> None:
        """Put `event` at the end of the log; a transient one is skipped."""
        if event.data.transient:
            return
        if not self._open:
            raise LogError(str(self.path), 0, "the session log is closed")
        line, self._head = seal(event, session=self.session, seq=self._seq + 1, prev=self._head)
        self._seq += 1
        self._records += 1
        self._pending += line.encode() + b"\n"
        durable = event.data.kind in DURABLE_KINDS
        waited = self._clock() - self._flushed_at
        if durable or self._records >= FLUSH_RECORDS or waited >= FLUSH_SECONDS:
            self.flush(durable=durable)

    def flush(self, *, durable: bool = True) -> None:
        """Write what is pending; `durable` also waits until the disk has it."""
        self._flushed_at = self._clock()
        try:
            while self._pending:
                written = os.write(self._file, self._pending)
                del self._pending[:written]
            self._records = 0
            if durable:
                os.fsync(self._file)
        except OSError as error:
            self._report(error)
        else:
            self.error = None

    def close(self) -> None:
        """Write everything and let go of the file; raises LogError when records would be lost."""
        if not self._open:
            return
        try:
            self.flush()
            if self._records:
                problem = f"{self._records} records at its end could not be written"
                raise LogError(str(self.path), 0, f"{problem}; {self.error and self.error.problem}")
        finally:
            self._open = False
            os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _report(self, error: OSError) -> None:
        first = self.error is None
        self.error = os_error(self.path, "write the session log", error)
        if self._on_error is None:
            raise self.error from error
        if first:
            self._on_error(self.error)

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            problem = "another console is writing this log; give this one a log of its own"
            raise LogError(str(self.path), 0, problem) from error
        except OSError as error:
            raise os_error(self.path, "lock the session log", error) from error

    def _continue(self) -> None:
        """Take the chain up where the file ends."""
        try:
            content = self.path.read_bytes()
            whole, end, torn = content.rpartition(b"\n")
            if torn:
                self._set_aside(torn, keep=len(whole) + len(end))
        except OSError as error:
            raise os_error(self.path, "continue the session log", error) from error
        if end:
            last = self._last_record(whole)
            self._seq, self._head = last.fields["seq"], last.hash

    def _last_record(self, content: bytes) -> Record:
        before, _, line = content.rpartition(b"\n")
        number = before.count(b"\n") + 2 if before else 1
        try:
            record = parse(line)
            problem = own_problem(record)
            if not problem and record.fields["session"] != self.session:
                problem = f"the log belongs to session {record.fields['session']!r}"
        except ValueError as error:
            problem = str(error)
        else:
            if not problem:
                return record
        raise LogError(str(self.path), number, f"{problem}; start a new log instead")

    def _set_aside(self, torn: bytes, keep: int) -> None:
        aside = self.path.with_name(self.path.name + ".torn")
        with aside.open("ab") as file:
            file.write(torn + b"\n")
            file.flush()
            os.fsync(file.fileno())
        os.ftruncate(self._file, keep)
