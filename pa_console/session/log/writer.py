"""The writer of a session log: a hash-chained, signed JSONL file that one console locks."""

import fcntl
import os
import re
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, Self

import platformdirs

from pa_console.private_files import make_private_folder, open_private
from pa_console.schema.events.event import Event, LogSigned
from pa_console.session.log.chain import (
    GENESIS,
    LogError,
    LogRecord,
    os_error,
    own_problem,
    parse,
    seal,
)
from pa_console.session.log.session_index import INDEX_NAME, SessionIndex, index_path
from pa_console.session.log.signed_head import (
    HeadKeeper,
    SignedHead,
    Witness,
    head_path,
    require_head,
    sign_head,
    write_head,
)
from pa_console.signing import KNOWN_FILE, Signer, key_path

_WRITE, _HEAD = "write the session log", "write the signed head of the session log"
_INDEX = "write the index of sessions"
FLUSH_RECORDS = 50
FLUSH_SECONDS = 1.0
SIGN_RECORDS = 100
SIGN_SECONDS = 5.0
DURABLE_KINDS = frozenset(
    (
        "session_started", "session_resumed", "incident", "mission_received", "decision_made",
        "plan_voided", "command_sent", "command_refused", "mission_finished", "all_stopped",
        "stop_released", "session_ended", "command_taken",
        "authority_changed",
    )
)  # fmt: skip
"""The kinds of events that are on the disk before `append` returns, because they may not be lost.
"""

_APPEND = os.O_WRONLY | os.O_CREAT | os.O_APPEND
_BY_ENDING = {
    ".head": "the signed head of a session log",
    ".head.new": "the signed head of a session log",
    ".torn": "the incomplete line that a crash left in a session log",
    ".sig": "the signature of a rule set",
}
_BY_START = {b'{"seq":': "a session log", b'{"closed":': "a witness of session logs"}


def default_folder() -> Path:
    """Return the folder of the user's session logs; it may not exist yet."""
    return platformdirs.user_state_path("pa-console") / "sessions"


def new_log_path(folder: Path, session: str) -> Path:
    """Create an empty log for `session` in `folder`, under a name that no other console uses.

    Raises LogError if the folder cannot be written to.
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


class LogFile:
    """An open log that no other console can open.

    `seq` and `hash` are those of its last record; `head` is its signed head, or None.
    """

    def __init__(self, path: Path, session: str, public: str | None) -> None:
        """Open a new log at `path`, or continue a log; move an incomplete last line to `PATH.torn`.

        Raises LogError without any change if the file cannot be opened, is locked by another
        console, belongs to another session, does not end with a valid record, or is shorter than
        its signed head states. The head must be signed by the key `public`, if that is given.
        """
        self.path = path
        self.seq, self.hash = 0, GENESIS
        try:
            make_private_folder(path.parent)
            self._file = open_private(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        except OSError as error:
            raise os_error(path, "open the session log", error) from error
        try:
            self._lock()
            torn = self._find_end(session)
            self.head = require_head(path, session, self.seq, public)
            # Nothing is changed before the head has been checked against the log.
            if torn:
                self._set_aside(torn)
        except BaseException:
            os.close(self._file)
            raise

    def write(self, pending: bytearray) -> None:
        """Write `pending`, and remove the written bytes from it; raises OSError."""
        while pending:
            written = os.write(self._file, pending)
            del pending[:written]

    def sync(self) -> None:
        """Wait until all written bytes are on the disk; raises OSError."""
        os.fsync(self._file)

    def close(self) -> None:
        """Close and unlock the file."""
        os.close(self._file)

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            problem = "another console is writing this log; use another log for this console"
            raise LogError(str(self.path), 0, problem) from error
        except OSError as error:
            raise os_error(self.path, "lock the session log", error) from error

    def _find_end(self, session: str) -> bytes:
        """Find the last record; return the incomplete line after it, or b""."""
        try:
            with open(self._file, "rb", closefd=False) as file:
                whole, end, torn = file.read().rpartition(b"\n")
        except OSError as error:
            raise os_error(self.path, "continue the session log", error) from error
        if end:
            last = self._last_record(whole, session)
            self.seq, self.hash = last.fields["seq"], last.hash
        return torn

    def _last_record(self, content: bytes, session: str) -> LogRecord:
        before, _, line = content.rpartition(b"\n")
        number = before.count(b"\n") + 2 if before else 1
        try:
            record = parse(line)
            problem = own_problem(record)
            if not problem and record.fields["session"] != session:
                problem = f"the log belongs to session “{record.fields['session']}”"
        except ValueError as error:
            problem = str(error)
        else:
            if not problem:
                return record
        raise LogError(str(self.path), number, f"{problem}; start a new log instead")

    def _set_aside(self, torn: bytes) -> None:
        aside = self.path.with_name(self.path.name + ".torn")
        try:
            with os.fdopen(open_private(aside, _APPEND), "ab") as file:
                file.write(torn + b"\n")
                file.flush()
                os.fsync(file.fileno())
            os.ftruncate(self._file, os.fstat(self._file).st_size - len(torn))
        except OSError as error:
            raise os_error(self.path, "continue the session log", error) from error


class LogWriter:
    """An open log to which one thread appends events.

    Records are written after FLUSH_RECORDS records or FLUSH_SECONDS seconds at the latest. Records
    of DURABLE_KINDS are written to the disk at once. With a `signer`, the log is signed after its
    first record, after each binding record, after SIGN_RECORDS records, with the first record after
    SIGN_SECONDS seconds, and on closing. The signed head is written after each signature: before
    the call returns, or soon afterwards if the signature was due only by time or number.

    While the disk cannot be written, records are kept in memory and written as soon as possible.
    `on_error` is called once at the beginning of each such period. Without `on_error`, `append` or
    `flush` raises the LogError; the event is still kept.
    """

    def __init__(
        self,
        path: Path,
        session: str,
        *,
        signer: Signer | None = None,
        index: SessionIndex | None = None,
        witness: Witness | None = None,
        on_error: Callable[[LogError], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open a new log at `path`, or continue a log; move an incomplete last line to `PATH.torn`.

        A signed log is added to the `index` of its folder when it begins and when it ends. Its
        heads are also sent to the `witness`, which is closed with the log. Raises LogError as
        LogFile does. The log's signed head, if it has one, must be signed by `signer`.
        """
        self.path, self.session = path, session
        self._signer, self._on_error, self._clock = signer, on_error, clock
        self._pending, self._records = bytearray(), 0
        self._file = LogFile(path, session, signer and signer.public)
        self._keeper = HeadKeeper(path, self._file.sync, self._seen)
        self._index, self._witness = index, witness
        self._begun = False
        self._seq, self._hash = self._file.seq, self._file.hash
        self._first = self._seq, self._hash
        self._last: Event | None = None
        self._owed: Literal["nothing", "disk", "signature"] = "nothing"
        signed = self._file.head.seq if self._file.head is not None else 0
        self._unsigned, self._unsigned_before = 0, self._seq - signed
        self._problems: dict[str, LogError] = {}
        """The error of each task whose last attempt failed."""
        self._flushed_at = self._signed_at = clock()
        try:
            if signer is not None and self._file.head is None:
                write_head(path, sign_head(session, 0, GENESIS, False, signer), lasting=True)
        except OSError as error:
            self._file.close()
            raise os_error(head_path(path), "write the signed head", error) from error
        self._open = True
        self.on_record: Callable[[str, str], None] = lambda _line, _hash: None
        """A function that is called with every new record, without its line end, and its hash."""

    @property
    def lines(self) -> int:
        """The number of records so far, including those from before the log was reopened."""
        return self._seq

    @property
    def head(self) -> str:
        """The hash of the last record; a copy kept elsewhere proves the whole log."""
        return self._hash

    @property
    def error(self) -> LogError | None:
        """The error of the last attempt to write the log or its signed head; None on success."""
        return self._problems.get(_WRITE) or self._problems.get(_HEAD)

    def news(self) -> str | None:
        """Return the problem of the witness if it has changed since the last call, else None."""
        return self._witness.news() if self._witness is not None else None

    @property
    def witness_problem(self) -> str:
        """The error of the last attempt to send a head to the witness; '' if it was received."""
        return self._witness.problem if self._witness is not None else ""

    @property
    def owes(self) -> bool:
        """True if a record waits to be signed or written to the disk by `commit`."""
        return self._owed != "nothing"

    def append(self, event: Event, *, commit: bool = True) -> None:
        """Append `event` to the log; a transient event is skipped.

        If `commit` is False, the signature or sync that the event needs is left to a later call of
        the method `commit`, because one signature is enough for all events of one moment.
        """
        if event.data.transient:
            return
        if not self._open:
            raise LogError(str(self.path), 0, "the session log is closed")
        first, self._last = self._last is None, event
        self._put(event)
        if first and self._seq == 1:
            self._first = self._seq, self._hash
        if self._signer is not None and (first or event.data.binding):
            self._owed = "signature"
        elif not self.owes and (event.data.binding or event.data.kind in DURABLE_KINDS):
            self._owed = "disk"
        if first or commit:
            self.commit()
        # While the disk cannot be written, attempts are due only by time, not by the number of
        # records.
        now, takes = self._clock(), _WRITE not in self._problems
        due = self._unsigned >= SIGN_RECORDS or now - self._signed_at >= SIGN_SECONDS
        full = self._records >= FLUSH_RECORDS and takes
        if self._signer is not None and due and takes:
            self._sign(event, self._signer, at_once=False)
        elif full or now - self._flushed_at >= FLUSH_SECONDS:
            self.flush(durable=False)

    def commit(self) -> None:
        """Write the urgent events, and sign them if needed; do nothing if there are none.

        The events remain due if the disk cannot be written.
        """
        if not self.owes:
            return
        signed = self._owed == "signature"
        if not signed or _WRITE in self._problems:
            self.flush()
        if signed and _WRITE not in self._problems:
            assert self._signer is not None
            assert self._last is not None
            self._sign(self._last, self._signer, at_once=True)
        if self.error is None:
            self._owed = "nothing"

    def flush(self, *, durable: bool = True) -> None:
        """Write the pending records; with `durable`, wait until they are on the disk."""
        self._flushed_at = self._clock()
        with self._reported(self.path, _WRITE):
            self._file.write(self._pending)
            self._records = 0
            if durable:
                self._file.sync()

    def close(self) -> None:
        """Write all records and close the file; raises LogError if records are lost."""
        if not self._open:
            return
        try:
            if self._signer is not None and self._last is not None:
                self._sign(self._last, self._signer, at_once=True, closing=True)
            else:
                self.flush()
            if self._records:
                problem = f"{self._records} records at its end could not be written"
                why = self._problems[_WRITE].problem
                raise LogError(str(self.path), 0, f"{problem}; {why}")
            if self._begun:
                self._add_to_index(self._seq, self._hash, ended=True)
        finally:
            self._open = False
            self._keeper.close()
            self._file.close()
            if self._witness is not None:
                self._witness.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def _put(self, event: Event, signer: Signer | None = None) -> None:
        line, self._hash = seal(
            event, session=self.session, seq=self._seq + 1, prev=self._hash, signer=signer
        )
        self._seq += 1
        self.on_record(line, self._hash)
        self._records += 1
        self._unsigned += 1
        self._pending += line.encode() + b"\n"

    def _sign(self, last: Event, signer: Signer, *, at_once: bool, closing: bool = False) -> None:
        """Sign the log up to `last`, and then its head, once the records are on the disk."""
        signed = LogSigned(key=signer.public, closing=closing, found=self._unsigned_before)
        self._put(Event(t=last.t, tick=last.tick, data=signed), signer)
        self._unsigned, self._unsigned_before, self._signed_at = 0, 0, self._clock()
        # A head must never cover records that a crash could still remove from the disk.
        self.flush(durable=at_once)
        if _WRITE in self._problems:
            return
        keep = self._keeper.keep_now if at_once else self._keeper.keep
        with self._reported(self.path, _HEAD):
            keep(sign_head(self.session, self._seq, self._hash, closing, signer))
        if at_once and not self._begun:
            self._begun = self._add_to_index(*self._first, ended=False)

    def _add_to_index(self, records: int, head: str, *, ended: bool) -> bool:
        """Add a line to the index of sessions; return False if that failed."""
        if self._index is not None:
            with self._reported(index_path(self.path.parent), _INDEX):
                self._index.add(self.path.name, self.session, records, head, ended=ended)
        return _INDEX not in self._problems

    def _seen(self, head: SignedHead, urgent: bool) -> None:
        if self._witness is not None:
            self._witness.see(head, urgent=urgent)

    @contextmanager
    def _reported(self, path: Path, task: str) -> Generator[None]:
        """Report the OSError of a `task`; report the next one only after the task has succeeded."""
        try:
            yield
        except OSError as error:
            again, problem = task in self._problems, os_error(path, task, error)
            self._problems[task] = problem
            if self._on_error is None:
                raise problem from error
            if not again:
                self._on_error(problem)
        else:
            self._problems.pop(task, None)


def open_session_log(
    session: str,
    signer: Signer,
    *,
    path: Path | None,
    folder: Path,
    on_error: Callable[[LogError], None],
    witness: Witness | None = None,
    resumed: bool = False,
) -> LogWriter:
    """Open the signed log of a session: at `path`, or a new log in `folder` that is indexed there.

    The log of a `resumed` session, which is at `path` in the folder, is also indexed. Raises
    LogError if the log cannot be opened.
    """
    return LogWriter(
        path or new_log_path(folder, session),
        session,
        signer=signer,
        index=SessionIndex(folder, signer) if path is None or resumed else None,
        witness=witness,
        on_error=on_error,
    )


def refuse_audit_file(path: Path) -> None:
    """Raise ValueError if `path` is an audit file, or has the name of an audit file."""
    if part := audit_part(path):
        raise ValueError(f"{path}: this is {part}, which is never overwritten; name another file")


def audit_part(path: Path) -> str:
    """Return the kind of audit file that `path` is, or has the name of; '' for any other file."""
    name = path.name.casefold()
    for ending, part in _BY_ENDING.items():
        if name.endswith(ending):
            return part
    if name == INDEX_NAME:
        return "the index of sessions"
    key = key_path()
    if any(_same(path, own) for own in (key, key.with_name(KNOWN_FILE))):
        return "the signing key, or one of the files beside it"
    if head_path(path).exists():  # the log itself may be gone
        return "a session log"
    try:
        with path.open("rb") as file:
            start = file.read(max(map(len, _BY_START)))
    except OSError:
        return ""
    return next((part for first, part in _BY_START.items() if start.startswith(first)), "")


def _same(path: Path, other: Path) -> bool:
    return path.absolute() == other.absolute() or (
        path.exists() and other.exists() and path.samefile(other)
    )
