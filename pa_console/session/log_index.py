"""Reads a log once, from end to end, into what finds any moment of it again quickly.

That is the byte position of every event, the Timeline, and keyframes: the folded session every so
often, with each mission that has changed since the keyframe before. After a seek, at most
FRAME_EVENTS events or FRAME_BYTES bytes that are no telemetry are left to fold.
"""

import io
import tempfile
import weakref
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import IO

from pa_console.schema import event as ev
from pa_console.session.chain import LogError, end_problem, lines_of, parse
from pa_console.session.fold import SessionState
from pa_console.session.keyframe import (
    MissionShelf,
    pack_mission,
    pack_state,
    unpack_mission,
)
from pa_console.session.marks import mark_of
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.telemetry_line import read_telemetry
from pa_console.session.timeline import Timeline

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
