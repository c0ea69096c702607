"""The index of sessions in a folder of logs, so that none of them vanishes or is cut unseen.

`sessions.index` has a line when a session has begun, with the hash of its first record, and one
when it has ended, with that of its last. Each line is canonical JSON with the fields of `Entry`,
is signed, and has the SHA-256 of the line before. The last line stands beside the signing key as
well: whoever can write to the logs alone cannot cut the index, and what was cut leaves a gap.
"""

import fcntl
import hashlib
import json
import os
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

from pydantic import TypeAdapter, ValidationError

from pa_console.private_files import make_private_folder, open_private, replace_private, sync_folder
from pa_console.schema.base import Hex32, Hex64
from pa_console.session.log.chain import GENESIS, os_error
from pa_console.signing import Signer, fingerprint, is_signature, key_path

INDEX_NAME = "sessions.index"
PURPOSE = b"pa-console index of sessions, line\n"
LOCK_S, LOCK_STEP_S = 5.0, 0.01
"""How long another console that writes its line is waited for."""


@dataclass(frozen=True)
class Entry:
    """The log named `log` of `session` has `records` records or more, that one with `hash`.

    `ended`: it had no more. `seq` is the number of the line, `prev` the hash of the one before.
    """

    ended: bool
    hash: Hex32
    key: Hex32
    log: str
    prev: Hex32
    records: int
    seq: int
    session: str
    signature: Hex64


_ENTRY = TypeAdapter(Entry)


def index_path(folder: Path) -> Path:
    """Return where the index of the logs in `folder` is."""
    return folder / INDEX_NAME


def anchor_path(folder: Path) -> Path:
    """Return where the last line of that index is kept, beside the signing key."""
    name = hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:32]
    return key_path().parent / "session-indexes" / name


class SessionIndex:
    """Adds the sessions of one console to the index of the folder that its log is in."""

    def __init__(self, folder: Path, signer: Signer) -> None:
        self._folder, self._signer = folder, signer

    def add(self, log: str, session: str, records: int, head: str, *, ended: bool) -> None:
        """Note that `log` has `records` records, the last with the hash `head`; raises OSError.

        A line follows the last one that this machine wrote, even where that is gone.
        """
        index, anchor = index_path(self._folder), anchor_path(self._folder)
        make_private_folder(anchor.parent)
        file = open_private(index, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        try:
            _lock(file)
            with open(file, "rb", closefd=False) as stream:
                content = stream.read()
            lines = content.splitlines(keepends=True)
            torn = b"" if not lines or lines[-1].endswith(b"\n") else b"\n"
            seq, prev = _end(lines, read_anchor(self._folder))
            line = entry_line(
                self._sign(Entry(ended, head, self._signer.public, log, prev, records,
                                 seq + 1, _plain(session), ""))
            )  # fmt: skip
            _write(file, torn + line)
            os.fsync(file)
            replace_private(anchor, line)
            with suppress(OSError):
                sync_folder(self._folder)
        finally:
            os.close(file)

    def _sign(self, entry: Entry) -> Entry:
        return replace(entry, signature=self._signer.sign(_signed_part(entry)))


def entry_line(entry: Entry) -> bytes:
    """Return `entry` as it stands in the index: one line, with its end."""
    return _text(asdict(entry))


def line_hash(line: bytes) -> str:
    """Return what the line after `line`, which has its end, names it by."""
    return hashlib.sha256(line).hexdigest()


def parse_entry(line: bytes) -> Entry:
    """Read a line of the index; raises ValueError for what no key has signed."""
    try:
        entry = _ENTRY.validate_json(line, strict=True)
    except ValidationError as error:
        raise ValueError("not a line of an index of sessions") from error
    if line != entry_line(entry) or not is_signature(
        entry.signature, _signed_part(entry), entry.key
    ):
        raise ValueError("the line was changed: its signature is not of what it says")
    return entry


def read_anchor(folder: Path) -> bytes:
    """Return the last line that this machine wrote to the index of `folder`; empty without one."""
    try:
        return anchor_path(folder).read_bytes()
    except FileNotFoundError:
        return b""


def _end(lines: list[bytes], anchor: bytes) -> tuple[int, str]:
    """Return number and hash of the line that a new one follows."""
    last = lines[-1] if lines else b""
    found = _number(last) if last else 0
    kept = _number(anchor) if anchor else 0
    if kept > found or (kept == found and last != anchor):
        return kept, line_hash(anchor)
    return (found or len(lines), line_hash(last)) if last else (0, GENESIS)


def _number(line: bytes) -> int:
    """Return the number of a line, 0 for one that nobody has signed."""
    try:
        return parse_entry(line).seq
    except ValueError:
        return 0


def _lock(file: int, sleep: Callable[[float], None] = time.sleep) -> None:
    """Wait until no other console writes; raises OSError when one does not end."""
    for _ in range(round(LOCK_S / LOCK_STEP_S)):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            sleep(LOCK_STEP_S)
        else:
            return
    raise BlockingIOError("another program holds the index of sessions")


def _write(file: int, content: bytes) -> None:
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(file, rest) :]


def _plain(text: str) -> str:
    return text.encode("utf-8", "replace").decode()


def _signed_part(entry: Entry) -> bytes:
    return PURPOSE + _text({k: v for k, v in asdict(entry).items() if k != "signature"})


def _text(fields: dict[str, Any]) -> bytes:
    text = json.dumps(fields, ensure_ascii=False, separators=(",", ":"), sort_keys=True)
    return text.encode("utf-8", "surrogatepass") + b"\n"


_CHUNK = 1 << 20


@dataclass(frozen=True)
class IndexedSession:
    """A session of the index; `problem` says what became of its log, empty when it is as it was."""

    log: str
    session: str
    ended: bool
    problem: str = ""


@dataclass(frozen=True)
class IndexReport:
    """The sessions of an index in their order, and what is wrong with the index itself."""

    sessions: tuple[IndexedSession, ...] = ()
    problems: tuple[str, ...] = ()

    @property
    def told(self) -> tuple[str, ...]:
        """Everything that is not as it should be, a sentence each."""
        logs = (f"{found.log}: {found.problem}" for found in self.sessions if found.problem)
        return (*self.problems, *logs)

    def of(self, log: Path) -> str:
        """Return what is wrong with `log` by the index; empty when nothing is or it has none."""
        problems = (found.problem for found in self.sessions if found.log == log.name)
        return next(filter(None, problems), "")


def check_index(folder: Path, known: Collection[str]) -> IndexReport:
    """Check the index of `folder`, and the first and the last record of every log in it.

    Lines of keys whose fingerprints are not `known` say nothing. Raises LogError when a file
    cannot be read.
    """
    path = index_path(folder)
    try:
        content = path.read_bytes()
        anchor = read_anchor(folder)
    except FileNotFoundError:
        content, anchor = b"", read_anchor(folder)
    except OSError as error:
        raise os_error(path, "read the index of sessions", error) from error
    entries: list[Entry] = []
    problems = list(_chain(path.name, content, known, entries))
    if anchor and anchor not in content.splitlines(keepends=True):
        problems.append(f"{path.name}: its last line that this machine wrote is gone")
    return IndexReport(tuple(_sessions(folder, entries)), tuple(problems))


def _chain(
    name: str, content: bytes, known: Collection[str], entries: list[Entry]
) -> Iterator[str]:
    """Follow the lines to their end; put those that are sound into `entries`, yield the damage."""
    seq, prev, sound = 0, GENESIS, True
    for number, line in enumerate(content.splitlines(keepends=True), start=1):
        try:
            entry = parse_entry(line)
        except ValueError as error:
            yield f"{name}:{number}: {error}"
            sound = False
            continue
        if sound and entry.seq != seq + 1:
            yield f"{name}:{number}: lines {seq + 1} to {entry.seq - 1} of the index are gone"
        elif sound and entry.prev != prev:
            yield f"{name}:{number}: the line before it was replaced"
        seq, prev, sound = entry.seq, line_hash(line), True
        if (key := fingerprint(entry.key)) in known:
            entries.append(entry)
        else:
            yield f"{name}:{number}: signed by an unknown key, {key}"


def _sessions(folder: Path, entries: list[Entry]) -> Iterator[IndexedSession]:
    by_log: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries:
        by_log.setdefault((entry.log, entry.session), []).append(entry)
    for (log, session), told in by_log.items():
        ended = any(entry.ended for entry in told)
        yield IndexedSession(log, session, ended, _problem(folder / log, session, told))


def _problem(log: Path, session: str, told: list[Entry]) -> str:
    """Return why `log` is not the one that the index tells of."""
    if log.name != told[0].log or not log.is_file():
        return f"the log of session {session} is missing"
    try:
        first, last = _ends(log)
    except OSError as error:
        raise os_error(log, "read the session log", error) from error
    records = last.get("seq", 0)
    for entry in told:
        if entry.records > records:
            ended = "ended with" if entry.ended else "had"
            return (
                f"cut short: session {session} {ended} {entry.records} records, {records} are left"
            )
        if entry.records in (1, records):
            found = first if entry.records == 1 else last
            if (found.get("hash"), found.get("session")) != (entry.hash, entry.session):
                return f"record {entry.records} is not the one that session {session} had"
    return ""


def _ends(log: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the first and the last whole record of `log`, {} for what is none."""
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


def _record(line: bytes) -> dict[str, Any]:
    try:
        found: object = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(found, dict):
        return {}
    record = cast(dict[str, Any], found)
    return record if isinstance(record.get("seq", 0), int) else {}
