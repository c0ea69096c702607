"""Reads a line of telemetry, the bulk of every log, in a third of the time of any other line."""

import re
from datetime import datetime
from typing import Literal, NamedTuple

from pydantic import ValidationError

from pa_console.schema.base import StrictModel
from pa_console.schema.telemetry import Picture

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
