"""Reads a session log back and verifies its chain."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pa_console.schema.event import Event
from pa_console.session.chain import LogError, Record, link_problem, os_error, parse


@dataclass(frozen=True)
class VerifyResult:
    """Whether a log is whole; `first_bad_line` counts from 1 and is None when nothing is wrong.

    `lines` are the sound lines up to there, `head` is the hash of the last of them, and `note`
    says what is worth knowing of a sound log.
    """

    ok: bool
    lines: int
    first_bad_line: int | None = None
    problem: str = ""
    note: str = ""
    session: str = ""
    head: str = ""


def read_log(path: Path) -> Iterator[Event]:
    """Yield the events of a log, the chain unchecked; raises LogError at the first bad line."""
    for number, line in read_lines(path):
        try:
            yield parse(line).event
        except ValueError as error:
            raise LogError(str(path), number, str(error)) from error


def read_lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield (line number from 1, line without its end); raises LogError for a torn last line."""
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                if not line.endswith(b"\n"):
                    raise LogError(str(path), number, "the line is cut short: it has no line end")
                yield number, line[:-1]
    except OSError as error:
        raise os_error(path, "read the session log", error) from error


def verify(path: Path) -> VerifyResult:
    """Check every record and the chain; raises LogError only when the file cannot be read."""
    before: Record | None = None
    lines, problem, line_number = 0, "", 0
    try:
        for number, line in read_lines(path):
            line_number = number
            record = parse(line)
            problem = link_problem(record, before)
            if problem:
                break
            before, lines = record, number
    except LogError as error:
        if not error.line:
            raise
        line_number, problem = error.line, error.problem
    except ValueError as error:
        problem = str(error)
    session, head = (before.fields["session"], before.hash) if before else ("", "")
    if problem:
        return VerifyResult(False, lines, line_number, problem, session=session, head=head)
    return VerifyResult(True, lines, note=_note(before), session=session, head=head)


def _note(last: Record | None) -> str:
    if last is None:
        return "the log is empty"
    if last.event.data.kind == "session_ended":
        return ""
    return (
        "no session end: the session is still running, stopped without warning, "
        f"or its log was cut off after line {last.fields['seq']}"
    )
