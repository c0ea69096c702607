"""Reads a session log back, telemetry faster than the rest."""

import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Literal, NamedTuple

from pydantic import ValidationError

from pa_console.schema.base import StrictModel
from pa_console.schema.events.event import Event
from pa_console.schema.telemetry import Picture
from pa_console.session.log.chain import LogError, end_problem, lines_of, os_error, parse

_TEXT = rb'"(?:[^"\\]|\\.)*"'
_BEGIN = re.compile(
    rb'\{"seq":\d+,"t":"[^"\\]+","tick":-?\d+,"session":' + _TEXT + rb',"mission":(?:null|' + _TEXT
    + rb'),"kind":"telemetry","data":\{"picture":\{'
)  # fmt: skip
_END = re.compile(rb'\}\},"prev":"[0-9a-f]*","hash":"[0-9a-f]*"\}$')
_TAIL = 400
"""Bytes at the end of a line that hold the two hashes."""


class _Data(StrictModel):
    picture: Picture


class _Line(StrictModel):
    """The fields of a record, in their order."""

    seq: int
    t: datetime
    tick: int
    session: str
    mission: str | None
    kind: Literal["telemetry"]
    data: _Data
    prev: str
    hash: str


class TelemetryLine(NamedTuple):
    """When a picture was received, and the simulated second it is of."""

    t: datetime
    tick: int
    picture_tick: int
    time_s: float


def read_telemetry(line: bytes) -> TelemetryLine | None:
    """Return what a sound line of telemetry says; None for any other, which `parse` reads."""
    if not (_BEGIN.match(line) and _END.search(line, max(0, len(line) - _TAIL))):
        return None
    try:
        found = _Line.model_validate_json(line)
    except ValidationError:
        return None
    picture = found.data.picture
    return TelemetryLine(found.t, found.tick, picture.tick, picture.time_s)


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
