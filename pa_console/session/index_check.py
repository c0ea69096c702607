"""Holds the logs in a folder against the index of sessions there: which is gone, which was cut."""

import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from pa_console.session.chain import GENESIS, os_error
from pa_console.session.session_index import (
    Entry,
    index_path,
    line_hash,
    parse_entry,
    read_anchor,
)
from pa_console.signing import fingerprint

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
