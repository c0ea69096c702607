"""Writes the session log: hash-chained and signed JSONL, one record a line, as it happens."""

import os
import re
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

import platformdirs

from pa_console.private_files import make_private_folder, open_private
from pa_console.schema.event import Event, LogSigned
from pa_console.session.chain import GENESIS, LogError, os_error, seal
from pa_console.session.head import head_path, sign_head, write_head
from pa_console.session.head_keeper import HeadKeeper
from pa_console.session.log_file import LogFile
from pa_console.session.reader import read_log
from pa_console.session.verify import VerifyResult, verify
from pa_console.signing import Signer

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
SIGN_RECORDS = 100
SIGN_SECONDS = 5.0
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
        make_private_folder(folder)
        while True:
            try:
                os.close(open_private(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
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
    safe on the disk at once for DURABLE_KINDS. With a `signer`, the log is signed after its first
    record, after every SIGN_RECORDS records, with the first record after SIGN_SECONDS seconds, and
    on closing; its signed head follows each time, at the first and the last one before the call
    returns, else soon after. When the disk refuses, the records are kept in
    memory and written as soon as it takes them again; `on_error` is told once each time that
    begins. Without `on_error` the LogError is raised from `append` or `flush` instead, and the
    event is kept all the same.
    """

    def __init__(
        self,
        path: Path,
        session: str,
        *,
        signer: Signer | None = None,
        on_error: Callable[[LogError], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open `path`, new or to be continued; a torn last line moves to `PATH.torn`.

        Raises LogError when the file cannot be opened, is held by another console, belongs to
        another session, does not end in a sound record, or is not what its signed head, of the
        key of `signer`, vouches for.
        """
        self.path, self.session = path, session
        self.error: LogError | None = None
        self._signer, self._on_error, self._clock = signer, on_error, clock
        self._pending, self._records = bytearray(), 0
        self._file = LogFile(path, session, signer and signer.public)
        self._keeper = HeadKeeper(path, self._file.sync)
        self._seq, self._hash = self._file.seq, self._file.hash
        self._last: Event | None = None
        signed = self._file.head.seq if self._file.head is not None else 0
        self._unsigned, self._found, self._headless = 0, self._seq - signed, False
        self._flushed_at = self._signed_at = clock()
        try:
            if signer is not None and self._file.head is None:
                write_head(path, sign_head(session, 0, GENESIS, False, signer), lasting=True)
        except OSError as error:
            self._file.close()
            raise os_error(head_path(path), "write the signed head", error) from error
        self._open = True

    @property
    def lines(self) -> int:
        """Records appended so far, those of an earlier opening included."""
        return self._seq

    @property
    def head(self) -> str:
        """The hash of the last record: noted down elsewhere, it vouches for the whole log."""
        return self._hash

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
        first, self._last = self._last is None, event
        self._put(event)
        waited = self._clock() - self._signed_at
        if self._signer is not None and (
            first or self._unsigned >= SIGN_RECORDS or waited >= SIGN_SECONDS
        ):
            self._sign(event, self._signer, at_once=first)
            return
        durable = event.data.kind in DURABLE_KINDS
        waited = self._clock() - self._flushed_at
        if durable or self._records >= FLUSH_RECORDS or waited >= FLUSH_SECONDS:
            self.flush(durable=durable)

    def flush(self, *, durable: bool = True) -> None:
        """Write what is pending; `durable` also waits until the disk has it."""
        self._flushed_at = self._clock()
        try:
            self._file.write(self._pending)
            self._records = 0
            if durable:
                self._file.sync()
        except OSError as error:
            self._report(error, "write the session log")
        else:
            self.error = None

    def close(self) -> None:
        """Write everything and let go of the file; raises LogError when records would be lost."""
        if not self._open:
            return
        try:
            if self._signer is not None and self._last is not None:
                self._sign(self._last, self._signer, at_once=True, closing=True)
            else:
                self.flush()
            if self._records:
                problem = f"{self._records} records at its end could not be written"
                raise LogError(str(self.path), 0, f"{problem}; {self.error and self.error.problem}")
        finally:
            self._open = False
            self._keeper.close()
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _put(self, event: Event, signer: Signer | None = None) -> None:
        line, self._hash = seal(
            event, session=self.session, seq=self._seq + 1, prev=self._hash, signer=signer
        )
        self._seq += 1
        self._records += 1
        self._unsigned += 1
        self._pending += line.encode() + b"\n"

    def _sign(self, last: Event, signer: Signer, *, at_once: bool, closing: bool = False) -> None:
        """Vouch for everything up to `last` in the log, and once it is on the disk in its head."""
        signed = LogSigned(key=signer.public, closing=closing, found=self._found)
        self._put(Event(t=last.t, tick=last.tick, data=signed), signer)
        self._unsigned, self._found, self._signed_at = 0, 0, self._clock()
        self.flush(durable=at_once or last.data.kind in DURABLE_KINDS)
        if self.error is not None:
            return
        keep = self._keeper.keep_now if at_once else self._keeper.keep
        try:
            keep(sign_head(self.session, self._seq, self._hash, closing, signer))
        except OSError as error:
            told, self._headless = self._headless, True
            if not told or self._on_error is None:
                self._report(error, "write the signed head of the session log")
        else:
            self._headless = False

    def _report(self, error: OSError, task: str) -> None:
        first = self.error is None
        self.error = os_error(self.path, task, error)
        if self._on_error is None:
            raise self.error from error
        if first:
            self._on_error(self.error)
