"""A saved index of a log: the places of the log's events, a timeline, and keyframes.

A keyframe is the session folded up to some event, as JSON without the picture, which is in the log.
The missions are packed one by one, and packed again only if they changed since the previous
keyframe. After a seek, at most FRAME_EVENTS events or FRAME_BYTES bytes that are not telemetry
remain to be folded.

The file of an index begins with one line of JSON: size and times of the log, the sizes of the other
parts, and a checksum. Then come the columns as they are in memory, and the packed keyframes. A file
is used only if it is complete, belongs to the unchanged log, and was made by the same code on the
same kind of machine.
"""

import hashlib
import io
import json
import os
import re
import shutil
import sys
import tempfile
import weakref
import zlib
from array import array
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple

from pydantic import TypeAdapter, ValidationError

import pa_console.schema
import pa_console.session
from pa_console.private_files import make_private_folder
from pa_console.schema.base import StrictModel
from pa_console.schema.events import event as ev
from pa_console.schema.telemetry import Picture
from pa_console.session.log.chain import RECORD_START, LogError, end_problem, lines_of, parse
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import NOTICES_KEPT, SessionState
from pa_console.session.timeline import RecordingTimeline, mark_of

FRAME_EVENTS = 256
FRAME_BYTES = 256 * 1024

_LINES_A_STEP = 2048

Progress = Callable[[int, int], None]
"""A function that is called with the number of bytes read so far and the total number."""

_Place = tuple[int, int]
"""The position and the size of packed bytes."""

_PICTURE = b',"data":{"picture":{'
_END = re.compile(rb'\}\},"prev":"[0-9a-f]*","hash":"[0-9a-f]*"\}$')
_TAIL = 400
"""The number of bytes at the end of a line that include the line's two hashes."""
KEPT = 12
"""The number of saved indexes; the most recently used ones are kept."""

_SUFFIX = ".replay-index"
_CHUNK = 1 << 20


class LogIndex:
    """An index of every event of a log, with the session at its keyframes.

    `positions` has one entry per event, and one for the end of the last line. `frames` are the
    event counts of the keyframes, and `frame_at` and `frame_size` their places in `blobs`.
    """

    def __init__(self, blobs: IO[bytes], first: int = 0) -> None:
        """Begin without events; packed keyframes and missions are in `blobs` from byte `first`.

        The file `blobs` is closed when the index is no longer used.
        """
        self.timeline = RecordingTimeline()
        self.problem: LogError | None = None
        self.positions = array("Q", [0])
        self.frames, self.frame_at, self.frame_size = array("Q"), array("Q"), array("Q")
        self.blobs, self._first = blobs, first
        weakref.finalize(self, blobs.close)

    @property
    def columns(self) -> dict[str, "array[float] | array[int]"]:
        """Every array by name, in a fixed order."""
        timeline = self.timeline
        return {
            "seconds": timeline.seconds,
            "ticks": timeline.ticks,
            "marks": timeline.marks,
            "positions": self.positions,
            "frames": self.frames,
            "frame_at": self.frame_at,
            "frame_size": self.frame_size,
        }

    def frame_before(self, count: int) -> int:
        """Return the event count of the last keyframe within `count` events; 0 if there is none."""
        place = bisect_right(self.frames, count)
        return self.frames[place - 1] if place else 0

    def state_at(self, count: int) -> SessionState:
        """Return the session, without its picture, at the keyframe of `count` events."""
        if not count:
            return SessionState()
        frame = bisect_right(self.frames, count) - 1
        packed = self._blob((self.frame_at[frame], self.frame_size[frame]))
        places, state = _keyframes().validate_json(packed)
        state.missions = self.shelf(places)
        state.notices = deque(state.notices, maxlen=NOTICES_KEPT)
        return state

    def shelf(self, places: Mapping[str, _Place]) -> "MissionShelf":
        """Return the missions packed at `places`."""
        return MissionShelf(
            places, lambda name: _missions().validate_json(self._blob(places[name]))
        )

    def _blob(self, place: _Place) -> bytes:
        at, size = place
        self.blobs.seek(self._first + at)
        return zlib.decompress(self.blobs.read(size))

    def put(self, unpacked: bytes) -> _Place:
        """Pack `unpacked` and append it to an index that is being built; return its place."""
        packed = zlib.compress(unpacked, 1)
        at = self.blobs.seek(0, io.SEEK_END)
        self.blobs.write(packed)
        return at, len(packed)

    def put_frame(self, count: int, places: Mapping[str, _Place], state: SessionState) -> int:
        """Append a keyframe of the first `count` events; return its size in bytes."""
        bare = replace(state, picture=None, missions={})
        at, size = self.put(_keyframes().dump_json((dict(places), bare)))
        self.frames.append(count)
        self.frame_at.append(at)
        self.frame_size.append(size)
        return size


# The adapters take long to build, so they are made when the first recording needs them.
@cache
def _keyframes() -> TypeAdapter[tuple[dict[str, _Place], SessionState]]:
    return TypeAdapter(tuple[dict[str, _Place], SessionState])


@cache
def _missions() -> TypeAdapter[MissionTrace]:
    return TypeAdapter(MissionTrace)


class MissionShelf(MutableMapping[str, MissionTrace]):
    """Missions by id, in the order of their arrival; each is loaded on first access."""

    def __init__(self, kept: Mapping[str, _Place], load: Callable[[str], MissionTrace]) -> None:
        """Begin with the missions `kept`, in their order; `load` returns one of them by its id."""
        self._order = dict.fromkeys(kept)
        self._load = load
        self._loaded: dict[str, MissionTrace] = {}

    def __getitem__(self, name: str) -> MissionTrace:
        if name not in self._loaded:
            if name not in self._order:
                raise KeyError(name)
            self._loaded[name] = self._load(name)
        return self._loaded[name]

    def __setitem__(self, name: str, trace: MissionTrace) -> None:
        self._order.setdefault(name)
        self._loaded[name] = trace

    def __delitem__(self, name: str) -> None:
        del self._order[name]
        self._loaded.pop(name, None)

    def __contains__(self, name: object) -> bool:
        return name in self._order

    def __iter__(self) -> Iterator[str]:
        return iter(self._order)

    def __len__(self) -> int:
        return len(self._order)


class _Data(StrictModel):
    picture: Picture


class _Line(StrictModel):
    """The fields of a record of telemetry, in their order."""

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
    """The time and tick of a record of telemetry, and the tick and time of its picture."""

    t: datetime
    tick: int
    picture_tick: int
    time_s: float


def read_telemetry(line: bytes) -> TelemetryLine | None:
    """Parse a line of telemetry, faster than `parse`; return None for any other or invalid line."""
    start = RECORD_START.match(line)
    if start is None or start[3] != b"telemetry" or not line.startswith(_PICTURE, start.end()):
        return None
    if not _END.search(line, max(0, len(line) - _TAIL)):
        return None
    try:
        record = _Line.model_validate_json(line)
    except ValidationError:
        return None
    picture = record.data.picture
    return TelemetryLine(record.t, record.tick, picture.tick, picture.time_s)


def build_index(
    path: Path,
    file: IO[bytes],
    size: int,
    progress: Progress | None = None,
    *,
    frame_events: int = FRAME_EVENTS,
) -> LogIndex:
    """Index the log `file` at `path` up to its first bad line or to `size` bytes.

    The error of a bad line becomes the index's `problem`. Raises OSError if the file cannot be
    read.
    """
    builder = _Builder(LogIndex(_scratch_file()), frame_events)
    index, position = builder.index, 0
    file.seek(0)
    for number, line in enumerate(lines_of(file), start=1):
        if position >= size:
            break
        if problem := end_problem(line):
            index.problem = LogError(str(path), number, problem)
            break
        try:
            builder.add(line[:-1], position)
        except ValueError as error:
            index.problem = LogError(str(path), number, str(error))
            break
        position += len(line)
        index.positions[-1] = position
        if progress is not None and number % _LINES_A_STEP == 0:
            progress(position, size)
    if progress is not None:
        progress(size, size)
    return index


def _scratch_file() -> IO[bytes]:
    """Return a temporary file without a name, in memory if no disk can hold it."""
    try:
        return tempfile.TemporaryFile(prefix="pa-console-")
    except OSError:
        return io.BytesIO()


class _Builder:
    """A fold over a log that makes keyframes and keeps only changed missions in memory."""

    def __init__(self, index: LogIndex, frame_events: int) -> None:
        self.index = index
        self._frame_events = frame_events
        self._state = SessionState(missions=index.shelf({}))
        self._places: dict[str, _Place] = {}
        self._changed: dict[str, None] = {}
        self._events = self._bytes = self._frame_bytes = 0

    def add(self, line: bytes, position: int) -> None:
        """Add the line at `position`; raises ValueError for a bad line."""
        timeline = self.index.timeline
        telemetry = read_telemetry(line)
        if telemetry is not None:
            timeline.add(telemetry.t, telemetry.tick, "telemetry", None)
            timeline.see_clock(telemetry.picture_tick, telemetry.time_s)
        else:
            event = parse(line).event
            if event.data.transient:
                return
            timeline.add(event.t, event.tick, event.data.kind, mark_of(event, self._state))
            if isinstance(event.data, ev.TelemetryReceived):
                timeline.see_clock(event.data.picture.tick, event.data.picture.time_s)
            else:
                self._fold(event, len(line))
        self.index.positions[-1] = position
        self.index.positions.append(position)

    def _fold(self, event: ev.Event, size: int) -> None:
        if self._is_due():
            self._take(len(self.index.timeline) - 1)
        self._state.apply(event)
        arrived = event.data.mission.id if isinstance(event.data, ev.MissionReceived) else None
        # When a station loses or regains authority, the plan that waits for approval changes.
        shown = self._state.active if isinstance(event.data, ev.AuthorityChanged) else None
        for name in (arrived, event.mission, shown):
            if name is not None and name in self._state.missions:
                self._changed[name] = None
        self._events += 1
        self._bytes += size

    def _is_due(self) -> bool:
        # The second condition keeps the index smaller than its log, however large a keyframe is.
        enough = self._events >= self._frame_events or self._bytes >= FRAME_BYTES
        return enough and self._bytes >= self._frame_bytes

    def _take(self, count: int) -> None:
        """Make the keyframe of the first `count` events."""
        index, state = self.index, self._state
        state.tick = max(state.tick, index.timeline.ticks[count - 1])
        self._frame_bytes = 0
        for name in self._changed:
            self._places[name] = index.put(_missions().dump_json(state.missions[name]))
            self._frame_bytes += self._places[name][1]
        self._frame_bytes += index.put_frame(count, self._places, state)
        self._changed = {}
        self._events = self._bytes = 0
        state.missions = index.shelf(self._places.copy())


def identity(file: IO[bytes]) -> list[int]:
    """Return the device, inode, size and times of an open log.

    Any change to the log changes at least one of them.
    """
    stat = os.fstat(file.fileno())
    return [stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns]


def index_path(folder: Path, log: Path) -> Path:
    """Return the path of the saved index of `log` in `folder`."""
    name = hashlib.sha256(os.fsencode(log.resolve())).hexdigest()[:32]
    return folder / f"{name}{_SUFFIX}"


def load_index(path: Path, log: Path, log_identity: list[int]) -> LogIndex | None:
    """Return the index at `path`; None unless it is complete and for `log` with this identity."""
    try:
        file = path.open("rb")
        try:
            index = _read(file, log, log_identity)
        except BaseException:
            file.close()
            raise
        with suppress(OSError):
            os.utime(path)
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        return None
    return index


def save_index(path: Path, index: LogIndex, log_identity: list[int]) -> None:
    """Write the index to `path`, completely or not at all; raises OSError."""
    make_private_folder(path.parent)
    timeline = index.timeline
    columns = {name: column.tobytes() for name, column in index.columns.items()}
    parts = [*columns.values(), bytes(timeline.kinds), bytes(timeline.mark_kinds)]
    blobs, total = index.blobs, index.blobs.seek(0, io.SEEK_END)
    problem = index.problem
    header = {
        "made_by": _made_by(),
        "log": log_identity,
        "sizes": [len(part) for part in parts],
        "blobs": total,
        "checksum": _checksum(parts, blobs, 0),
        "start": timeline.start.isoformat() if timeline.start else "",
        "ticks_per_s": timeline.ticks_per_s,
        "problem": [problem.line, problem.problem] if problem else None,
    }
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(json.dumps(header).encode() + b"\n")
            for part in parts:
                file.write(part)
            blobs.seek(0)
            shutil.copyfileobj(blobs, file, _CHUNK)
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
    _drop_oldest(path.parent)


def _read(file: IO[bytes], log: Path, log_identity: list[int]) -> LogIndex:
    """Return the index in `file`; raises ValueError if it is damaged or for another log."""
    header: dict[str, Any] = json.loads(file.readline())
    if header["made_by"] != _made_by() or header["log"] != log_identity:
        raise ValueError("of another log, or made by other code")
    parts = [file.read(size) for size in header["sizes"]]
    first = file.tell()
    if _checksum(parts, file, first) != header["checksum"]:
        raise ValueError("damaged")
    index = LogIndex(file, first)
    timeline = index.timeline
    *columns, kinds, mark_kinds = parts
    for column, part in zip(index.columns.values(), columns, strict=True):
        del column[:]
        column.frombytes(part)
    timeline.kinds, timeline.mark_kinds = bytearray(kinds), bytearray(mark_kinds)
    timeline.start = datetime.fromisoformat(header["start"]) if header["start"] else None
    timeline.ticks_per_s = header["ticks_per_s"]
    if header["problem"] is not None:
        index.problem = LogError(str(log), *header["problem"])
    return index


def _checksum(parts: list[bytes], blobs: IO[bytes], first: int) -> int:
    total = 0
    for part in parts:
        total = zlib.crc32(part, total)
    blobs.seek(first)
    while chunk := blobs.read(_CHUNK):
        total = zlib.crc32(chunk, total)
    return total


@cache
def _made_by() -> str:
    """Return a hash of the code that folds sessions and of this machine's number formats."""
    digest = hashlib.sha256(f"{sys.byteorder} {array('Q').itemsize}".encode())
    for package in (pa_console.session, pa_console.schema):
        for file in sorted(Path(package.__path__[0]).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _drop_oldest(folder: Path) -> None:
    with suppress(OSError):
        files = sorted(folder.glob(f"*{_SUFFIX}"), key=lambda file: file.stat().st_mtime_ns)
        for file in files[:-KEPT]:
            file.unlink()
