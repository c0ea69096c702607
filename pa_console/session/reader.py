"""Reads a session log back."""

from collections.abc import Iterator
from pathlib import Path

from pa_console.schema.event import Event
from pa_console.session.chain import LogError, end_problem, lines_of, os_error, parse


def read_log(path: Path) -> Iterator[Event]:
    """Yield what a log tells, the chain unchecked; raises LogError at the first bad line."""
    for number, line in read_lines(path):
        try:
            event = parse(line).event
        except ValueError as error:
            raise LogError(str(path), number, str(error)) from error
        if not event.data.transient:
            yield event


def read_lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield (line number from 1, line without its end).

    Raises LogError for a torn last line and for one that is too long.
    """
    try:
        with path.open("rb") as file:
            for number, line in enumerate(lines_of(file), start=1):
                if problem := end_problem(line):
                    raise LogError(str(path), number, problem)
                yield number, line[:-1]
    except OSError as error:
        raise os_error(path, "read the session log", error) from error


def line_of(path: Path, event: int) -> int:
    """Return the line of what a log tells as event number `event`, from 1; 0 if there is none.

    Signatures take lines of their own. Raises LogError when the log cannot be read so far.
    """
    told = 0
    for number, line in read_lines(path):
        try:
            told += not parse(line).event.data.transient
        except ValueError as error:
            raise LogError(str(path), number, str(error)) from error
        if told == event:
            return number
    return 0
