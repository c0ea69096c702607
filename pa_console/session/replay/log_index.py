"""Reads a log once into what finds any moment of it again, and keeps that for the next time.

That is the byte position of every event, the Timeline, and keyframes: the folded session every so
often, with each mission that has changed since the keyframe before. After a seek, at most
FRAME_EVENTS events or FRAME_BYTES bytes that are no telemetry are left to fold.

The file is one line of JSON (the log's own size and times, the sizes of what follows and their
checksum), the columns as they are in memory, and the packed states and missions. It is used only
if it is whole, of the log as it is now, and made by the same code on the same kind of machine.
"""

import hashlib
import io
import json
import os
import shutil
import sys
import tempfile
import weakref
import zlib
from array import array
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import IO, Any

import pa_console.schema
import pa_console.session
from pa_console.private_files import make_private_folder
from pa_console.schema.events import event as ev
from pa_console.session.log.chain import LogError, end_problem, lines_of, parse
from pa_console.session.log.reader import read_telemetry
from pa_console.session.replay.keyframe import (
    MissionShelf,
    pack_mission,
    pack_state,
    unpack_mission,
)
from pa_console.session.replay.timeline import Timeline, mark_of
from pa_console.session.state.fold import SessionState
from pa_console.session.state.mission_trace import MissionTrace

FRAME_EVENTS = 256
FRAME_BYTES = 256 * 1024
_GROWTH = 4
"""A keyframe is made only after a fourth of the bytes that the one before took."""

_LINES_A_STEP = 2048

Progress = Callable[[int, int], None]
"""Takes how many bytes of how many were read."""


class LogIndex:
    """Where everything in a log is; only one that is being built may be `put` into.

    `positions` has one more entry than there are events, where the last line ends. `frames` are
    the event counts of the keyframes, `frame_at` and `frame_size` their places in `blobs`; the
    k-th packed mission is number `pack_mission[k]` of `missions`, as of frame `pack_frame[k]`.
    """

    def __init__(self, blobs: IO[bytes], first: int = 0) -> None:
        """Begin with no event; packed states and missions are in `blobs` from byte `first` on.

        The file is closed with the last use of the index.
        """
        self.timeline = Timeline()
        self.problem: LogError | None = None
        self.positions = array("Q", [0])
        self.missions: list[str] = []
        self.frames, self.frame_at, self.frame_size = array("Q"), array("Q"), array("Q")
        self.pack_mission, self.pack_frame = array("Q"), array("Q")
        self.pack_at, self.pack_size = array("Q"), array("Q")
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
            "pack_mission": self.pack_mission,
            "pack_frame": self.pack_frame,
            "pack_at": self.pack_at,
            "pack_size": self.pack_size,
        }

    def blob(self, at: int, size: int) -> bytes:
        """Return what was packed there."""
        self.blobs.seek(self._first + at)
        return self.blobs.read(size)

    def put(self, packed: bytes) -> int:
        """Append what was packed; return where."""
        at = self.blobs.seek(0, io.SEEK_END)
        self.blobs.write(packed)
        return at


def build_index(
    path: Path,
    file: IO[bytes],
    size: int,
    progress: Progress | None = None,
    *,
    frame_events: int = FRAME_EVENTS,
) -> LogIndex:
    """Read the log `file`, which is at `path`, up to its first bad line or to `size` bytes.

    What is wrong with the bad line is the index's `problem`. Raises OSError.
    """
    builder = _Builder(LogIndex(scratch_file()), frame_events)
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


def scratch_file() -> IO[bytes]:
    """Return a file that vanishes with its last user; it is in memory where no disk takes it."""
    try:
        return tempfile.TemporaryFile(prefix="pa-console-")
    except OSError:
        return io.BytesIO()


class _Builder:
    """Folds the log and takes keyframes; of the missions only those in work stay in memory."""

    def __init__(self, index: LogIndex, frame_events: int) -> None:
        self.index = index
        self._frame_events = frame_events
        self._state = SessionState(missions=MissionShelf((), self._load))
        self._numbers: dict[str, int] = {}
        self._latest_pack: dict[str, tuple[int, int]] = {}
        self._changed: dict[str, None] = {}
        self._events = self._bytes = self._frame_bytes = 0

    def add(self, line: bytes, position: int) -> None:
        """Take the line at `position` in; raises ValueError that says what is wrong with it."""
        timeline = self.index.timeline
        telemetry = read_telemetry(line)
        if telemetry is not None:
            timeline.add(telemetry.t, telemetry.tick, "telemetry", None)
            self._see_clock(telemetry.picture_tick, telemetry.time_s)
        else:
            event = parse(line).event
            if event.data.transient:
                return
            timeline.add(event.t, event.tick, event.data.kind, mark_of(event, self._state))
            if isinstance(event.data, ev.TelemetryReceived):
                self._see_clock(event.data.picture.tick, event.data.picture.time_s)
            else:
                self._fold(event, len(line))
        self.index.positions[-1] = position
        self.index.positions.append(position)

    def _see_clock(self, tick: int, time_s: float) -> None:
        if time_s > 0:
            self.index.timeline.ticks_per_s = tick / time_s

    def _fold(self, event: ev.Event, size: int) -> None:
        if self._is_due():
            self._take(len(self.index.timeline) - 1)
        self._state.apply(event)
        touched = event.mission
        if isinstance(event.data, ev.MissionReceived):
            arrived = event.data.mission.id
            if arrived not in self._numbers:
                self._numbers[arrived] = len(self.index.missions)
                self.index.missions.append(arrived)
            self._changed[arrived] = None
        if touched is not None and touched in self._numbers:
            self._changed[touched] = None
        self._events += 1
        self._bytes += size

    def _is_due(self) -> bool:
        enough = self._events >= self._frame_events or self._bytes >= FRAME_BYTES
        return enough and self._bytes >= self._frame_bytes // _GROWTH

    def _take(self, count: int) -> None:
        """Make the keyframe of the first `count` events."""
        index, state = self.index, self._state
        ticks = index.timeline.ticks
        state.tick = max(state.tick, ticks[count - 1])
        packed = pack_state(state)
        frame, self._frame_bytes = len(index.frames), 0
        index.frames.append(count)
        index.frame_at.append(index.put(packed))
        index.frame_size.append(len(packed))
        for name in self._changed:
            packed = pack_mission(state.missions[name])
            at = index.put(packed)
            self._frame_bytes += _GROWTH * len(packed)
            self._latest_pack[name] = at, len(packed)
            index.pack_mission.append(self._numbers[name])
            index.pack_frame.append(frame)
            index.pack_at.append(at)
            index.pack_size.append(len(packed))
        self._changed = {}
        self._events = self._bytes = 0
        state.missions = MissionShelf(index.missions, self._load)

    def _load(self, name: str) -> MissionTrace:
        return unpack_mission(self.index.blob(*self._latest_pack[name]))


KEPT = 12
"""So many indexes are kept, those used last."""

_SUFFIX = ".replay-index"
_CHUNK = 1 << 20


def identity(file: IO[bytes]) -> list[int]:
    """Return what changes whenever an open log does: device, file, size and times."""
    stat = os.fstat(file.fileno())
    return [stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns]


def index_path(folder: Path, log: Path) -> Path:
    """Return where in `folder` the index of `log` is kept."""
    name = hashlib.sha256(os.fsencode(log.resolve())).hexdigest()[:32]
    return folder / f"{name}{_SUFFIX}"


def load_index(path: Path, log: Path, known: list[int]) -> LogIndex | None:
    """Return the index at `path` if it is whole and of the `log` whose identity is `known`."""
    try:
        file = path.open("rb")
        try:
            index = _read(file, log, known)
        except BaseException:
            file.close()
            raise
        with suppress(OSError):
            os.utime(path)
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        return None
    return index


def save_index(path: Path, index: LogIndex, known: list[int]) -> None:
    """Write the index to `path`, wholly or not at all; raises OSError."""
    make_private_folder(path.parent)
    timeline = index.timeline
    columns = {name: column.tobytes() for name, column in index.columns.items()}
    parts = [*columns.values(), bytes(timeline.kinds), bytes(timeline.mark_kinds)]
    blobs, total = index.blobs, index.blobs.seek(0, io.SEEK_END)
    problem = index.problem
    header = {
        "made_by": _made_by(),
        "log": known,
        "sizes": [len(part) for part in parts],
        "blobs": total,
        "checksum": _checksum(parts, blobs, 0),
        "missions": index.missions,
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


def _read(file: IO[bytes], log: Path, known: list[int]) -> LogIndex:
    """Return the index in `file`; raises ValueError when it is not to be used."""
    header: dict[str, Any] = json.loads(file.readline())
    if header["made_by"] != _made_by() or header["log"] != known:
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
    index.missions = header["missions"]
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
    """Return what stands for the code that folds, and for how this machine writes numbers."""
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
