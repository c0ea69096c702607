"""The file of a session log: locked by one console, continued at its sound end, never replaced."""

import fcntl
import os
from pathlib import Path

from pa_console.private_files import make_private_folder, open_private
from pa_console.session.log.chain import GENESIS, LogError, LogRecord, os_error, own_problem, parse
from pa_console.session.log.session_index import INDEX_NAME
from pa_console.session.log.signed_head import head_path, require_head
from pa_console.signing import KNOWN_FILE, key_path

_BY_ENDING = {
    ".head": "the signed head of a session log",
    ".head.new": "the signed head of a session log",
    ".torn": "what a crash left of a session log",
    ".sig": "the signature of a rule set",
}
_BY_START = {
    b'{"seq":': "a session log",
    b'{"closed":': "a witness of session logs",
}


def refuse_audit_file(path: Path) -> None:
    """Raise ValueError if `path` is a file of an audit, or has the name of one."""
    if part := audit_part(path):
        raise ValueError(f"{path}: this is {part}, which is never written over; name another file")


def audit_part(path: Path) -> str:
    """Return the part of an audit that the file `path` is, or would be by its name; else empty."""
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


_APPEND = os.O_WRONLY | os.O_CREAT | os.O_APPEND


class LogFile:
    """An open log that no other console can open.

    `seq` and `hash` are those of its last record, `head` is its signed head, if there is one.
    """

    def __init__(self, path: Path, session: str, public: str | None) -> None:
        """Open `path`, new or to be continued; a torn last line moves to `PATH.torn`.

        Raises LogError, with nothing changed, if the file cannot be opened, is locked by another
        console, belongs to another session, does not end in a sound record, or is shorter than its
        signed head states. The head must be signed by the key `public`, if that is given.
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
            if torn:
                self._set_aside(torn)
        except BaseException:
            os.close(self._file)
            raise

    def write(self, pending: bytearray) -> None:
        """Append `pending` and remove from it the bytes that were written; raise OSError."""
        while pending:
            written = os.write(self._file, pending)
            del pending[:written]

    def sync(self) -> None:
        """Wait until all written bytes are on the disk; raise OSError."""
        os.fsync(self._file)

    def close(self) -> None:
        """Close and unlock the file."""
        os.close(self._file)

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            problem = "another console is writing this log; give this one a log of its own"
            raise LogError(str(self.path), 0, problem) from error
        except OSError as error:
            raise os_error(self.path, "lock the session log", error) from error

    def _find_end(self, session: str) -> bytes:
        """Find the last record; return the bytes after it, a line without its end."""
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
