"""The records of a session log: their canonical JSON, their hash chain, and reading them.

A record is a JSON object with the fields of `FIELDS`, in that order. `hash` is the SHA-256, in
hexadecimal, of the record without `hash` as canonical JSON. `prev` is the `hash` of the previous
record, or GENESIS in the first one, whose `seq` is 1. The signature of a `log_signed` record covers
PURPOSE and the same canonical JSON without `signature`.
"""

import errno
import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC
from pathlib import Path
from typing import IO, Any, NoReturn, cast, get_args

from pydantic import TypeAdapter, ValidationError

from pa_console.private_files import NotPrivateError
from pa_console.schema.document import DocumentError
from pa_console.schema.events.event import Event, EventPayload, SessionStarted
from pa_console.signing import Signer, canonical_json

FIELDS = ("seq", "t", "tick", "session", "mission", "kind", "data", "prev", "hash")
GENESIS = "0" * 64
PURPOSE = b"pa-console session log, record\n"
KINDS = frozenset(
    payload.model_fields["kind"].default for payload in get_args(get_args(EventPayload)[0])
)
LINE_LIMIT = 4 << 20
"""The limit on the bytes of a line; the picture of a thousand assets takes a seventh of it."""

_TEXT = rb'"(?:[^"\\]|\\.)*"'
RECORD_START = re.compile(
    rb'\{"seq":\d+,"t":"([^"\\]+)","tick":-?\d+,"session":' + _TEXT
    + rb',"mission":(?:null|(' + _TEXT + rb')),"kind":"([a-z_]+)"'
)  # fmt: skip
"""The start of a record, with its `t`, mission and kind, by which most lines can be skipped."""

TORN = "the line is cut short: it has no line end"
_JSON = TypeAdapter(Any)
_DISK_FULL = frozenset((errno.ENOSPC, errno.EDQUOT))


class LogError(DocumentError):
    """An error for a session log that cannot be written or read; `line` is 0 if it has no line."""

    def __init__(self, source: str, line: int, problem: str) -> None:
        super().__init__(source, line, "", problem)


def os_error(path: Path, task: str, error: OSError) -> LogError:
    """Return the LogError for the `error` of a `task` on the log at `path`, with a remedy."""
    reason = error.strerror or str(error)
    if not isinstance(error, NotPrivateError):
        remedy = "free some space on that disk" if error.errno in _DISK_FULL else "check the path"
        reason += f"; {remedy}"
    return LogError(str(path), 0, f"cannot {task}: {reason}")


@dataclass(frozen=True)
class LogRecord:
    """A line of the log as it was read, before its place in the chain has been checked."""

    text: str
    fields: dict[str, Any]
    event: Event

    @property
    def hash(self) -> str:
        """The hash that the record states."""
        return str(self.fields["hash"])


def encodable(text: str) -> str:
    """Return `text` with a question mark for each lone surrogate, which UTF-8 cannot encode."""
    return text.encode("utf-8", "replace").decode()


def seal(
    event: Event, *, session: str, seq: int, prev: str, signer: Signer | None = None
) -> tuple[str, str]:
    """Return the record of `event` as one line of text, without its line end, and its hash.

    Lone surrogates become question marks. If a `signer` is given, it signs the LogSigned event.
    """
    moment = event.t.astimezone(UTC).replace(tzinfo=None).isoformat(timespec="microseconds")
    fields: dict[str, Any] = {
        "seq": seq,
        "t": moment + "Z",
        "tick": event.tick,
        "session": session,
        "mission": event.mission,
        "kind": event.data.kind,
        "data": event.data.model_dump(mode="json", exclude={"kind"}),
        "prev": prev,
    }
    if not (text := _in_order(fields)).isascii():
        fields = json.loads(encodable(text))
    if signer is not None:
        fields["data"]["signature"] = signer.sign(signed_part(fields))
    fields["hash"] = digest(fields)
    return _in_order(fields), fields["hash"]


def digest(fields: dict[str, Any]) -> str:
    """Return the hash that a record with `fields` must have."""
    rest = {key: value for key, value in fields.items() if key != "hash"}
    return hashlib.sha256(canonical_json(rest).encode()).hexdigest()


def signed_part(fields: dict[str, Any]) -> bytes:
    """Return the bytes that the signature of a LogSigned record with `fields` covers."""
    rest = {key: value for key, value in fields.items() if key != "hash"}
    rest["data"] = {key: value for key, value in fields["data"].items() if key != "signature"}
    return PURPOSE + canonical_json(rest).encode()


def parse(line: bytes) -> LogRecord:
    """Parse one line of a log, without its line end; raises ValueError for the first problem."""
    text, fields = _load(line)
    if tuple(fields) != FIELDS:
        raise ValueError(f"not a record of a session log: its fields must be {', '.join(FIELDS)}")
    kind, data = fields["kind"], fields["data"]
    if not isinstance(kind, str) or kind not in KINDS:
        raise ValueError(f"unknown kind of event “{kind}”")
    if not isinstance(data, dict):
        raise ValueError("data must be an object")
    content = {key: fields[key] for key in ("t", "tick", "mission")}
    content["data"] = {**cast(dict[str, Any], data), "kind": kind}
    # Strict models accept dates and tuples only from JSON, so the event goes through JSON again.
    try:
        return LogRecord(text, fields, Event.model_validate_json(_JSON.dump_json(content)))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"] if part != kind)
        raise ValueError(f"{field}: {first['msg']}") from error


def own_problem(record: LogRecord) -> str:
    """Return the problem of `record` apart from the chain; '' if it is as it was written."""
    # The text is compared too, because the same JSON in another notation has the same hash.
    if _in_order(record.fields) != record.text or record.hash != digest(record.fields):
        return "the record was edited: its hash does not match its content"
    return ""


def link_problem(record: LogRecord, before: LogRecord | None) -> str:
    """Return the problem of `record` as the successor of `before`; '' if there is none."""
    fields = record.fields
    seq, prev = (before.fields["seq"] + 1, before.hash) if before else (1, GENESIS)
    if problem := own_problem(record):
        return problem
    if fields["seq"] != seq:
        return f"seq is {fields['seq']}, not {seq}: a record was removed, inserted or moved"
    if fields["prev"] != prev:
        return "prev is not the hash of the previous record: that record was replaced"
    if before is not None and fields["session"] != before.fields["session"]:
        return f"the record is of another session, “{fields['session']}”"
    return ""


def lines_of(file: IO[bytes]) -> Iterator[bytes]:
    """Yield the lines of a log with their ends; a line beyond LINE_LIMIT is yielded in pieces."""
    while line := file.readline(LINE_LIMIT):
        yield line


def end_problem(line: bytes) -> str:
    """Return the problem with the end of `line`, which `lines_of` yielded; '' if it is complete."""
    if line.endswith(b"\n"):
        return ""
    if len(line) < LINE_LIMIT:
        return TORN
    return f"the line is longer than {LINE_LIMIT >> 20} MiB, the limit for a record"


def read_lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield each line of a log without its line end, with its number from 1.

    Raises LogError for an incomplete last line and for a line beyond LINE_LIMIT.
    """
    try:
        with path.open("rb") as file:
            for number, line in enumerate(lines_of(file), start=1):
                if problem := end_problem(line):
                    raise LogError(str(path), number, problem)
                yield number, line[:-1]
    except OSError as error:
        raise os_error(path, "read the session log", error) from error


def _read_events(path: Path) -> Iterator[tuple[int, Event]]:
    for number, line in read_lines(path):
        try:
            event = parse(line).event
        except ValueError as error:
            raise LogError(str(path), number, str(error)) from error
        if not event.data.transient:
            yield number, event


def read_log(path: Path) -> Iterator[Event]:
    """Yield the events of a log without checking the chain; raises LogError for a bad line."""
    return (event for _, event in _read_events(path))


def session_start(first: Event | None, log: Path) -> SessionStarted:
    """Return the start of the session of `log`, given the log's `first` event.

    Raises LogError if `first` is None (the log is empty) or not the start of a session.
    """
    if first is None:
        raise LogError(str(log), 1, "the log is empty")
    if not isinstance(first.data, SessionStarted):
        raise LogError(str(log), 1, "the log does not begin with the start of a session")
    return first.data


def line_of(path: Path, event: int) -> int:
    """Return the line number of event number `event`, both from 1; 0 if there is no such event.

    The two numbers differ, because signatures have lines of their own. Raises LogError for a bad
    line before that event.
    """
    numbers = (number for number, _ in _read_events(path))
    return next((line for at, line in enumerate(numbers, start=1) if at == event), 0)


def _load(line: bytes) -> tuple[str, dict[str, Any]]:
    try:
        text = line.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError("not UTF-8 text") from error
    try:
        value: object = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not valid JSON: {error}") from error
    if not isinstance(value, dict):
        raise ValueError("not a record of a session log: a JSON object is expected")
    return text, cast(dict[str, Any], value)


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _in_order(fields: dict[str, Any]) -> str:
    """Return `fields` as a line: compact JSON in the order of FIELDS."""
    return json.dumps(fields, ensure_ascii=False, separators=(",", ":"))
