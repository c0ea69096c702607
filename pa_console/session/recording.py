"""A recorded session, and a player whose state equals that of the live session.

The timeline is in memory, and the events are read from the disk.
"""

import io
import json
import os
import weakref
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Self

from pa_console.schema.events.event import Event, SessionStarted
from pa_console.session.log.chain import LogError, os_error, parse, session_start
from pa_console.session.log_index import (
    LogIndex,
    Progress,
    build_index,
    identity,
    index_path,
    load_index,
    save_index,
)
from pa_console.session.state import SessionState
from pa_console.session.timeline import MarkKind, RecordingTimeline, mark_of

_CONTENT, _LINKED = b',"mission":', b',"prev":'
_CHANGED = "changed since the log was opened"
CACHED_FROM = 4_000_000
"""The size of a log, in bytes, from which its index is saved."""

RATES = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)


class Recording:
    """The events of a session, each of which is read from the log on access."""

    def __init__(self, events: Iterable[Event] = ()) -> None:
        """Hold `events` in memory, except transient ones, which a log would not have either."""
        self._held: list[Event] = []
        self.index = LogIndex(io.BytesIO())
        self._path, self._file = Path(), None
        state = SessionState()
        for event in events:
            if not event.data.transient:
                mark = mark_of(event, state)
                state.apply(event)
                self.timeline.add(event.t, event.tick, event.data.kind, mark)
                if event.data.kind == "telemetry":
                    picture = event.data.picture
                    self.timeline.see_clock(picture.tick, picture.time_s)
                self._held.append(event)

    @classmethod
    def read(
        cls,
        path: Path,
        progress: Progress | None = None,
        *,
        cache: Path | None = None,
        cached_from: int = CACHED_FROM,
        frame_events: int | None = None,
    ) -> Self:
        """Open a log up to its first bad line; raises LogError if it has no good line.

        If the log has at least `cached_from` bytes, its index is saved in the folder `cache`, if
        that is given and can be written. `frame_events` is the number of events between keyframes.
        """
        recording = cls()
        try:
            file = path.open("rb")
        except OSError as error:
            raise os_error(path, "read the session log", error) from error
        recording._path, recording._file = path, file
        weakref.finalize(recording, file.close)
        log_identity = identity(file)
        kept = index_path(cache, path) if cache and log_identity[2] >= cached_from else None
        index = load_index(kept, path, log_identity) if kept else None
        if index is None:
            options = {"frame_events": frame_events} if frame_events is not None else {}
            try:
                index = build_index(path, file, log_identity[2], progress, **options)
            except OSError as error:
                raise os_error(path, "read the session log", error) from error
            if kept is not None:
                with suppress(OSError):
                    save_index(kept, index, log_identity)
        if index.problem is not None and not len(index.timeline):
            raise index.problem
        recording.index = index
        return recording

    @property
    def path(self) -> Path | None:
        """The path of the log; None for events in memory."""
        return self._path if self._file is not None else None

    @property
    def timeline(self) -> RecordingTimeline:
        """The time, kind and mark of every event."""
        return self.index.timeline

    @property
    def problem(self) -> LogError | None:
        """The error at which the reading of the log ended early, or None."""
        return self.index.problem

    @property
    def started(self) -> SessionStarted:
        """The start of the session; raises LogError if the log does not begin with it."""
        return session_start(self[0] if len(self) else None, self._path)

    def __len__(self) -> int:
        return len(self.timeline)

    def __getitem__(self, index: int) -> Event:
        if self._file is None:
            return self._held[index]
        if not 0 <= index < len(self):
            raise IndexError(index)
        try:
            return parse(self._line(index)).event
        except ValueError as error:
            problem = f"event {index + 1} has {_CHANGED}: {error}"
            raise LogError(str(self._path), 0, problem) from error

    def _line(self, index: int) -> bytes:
        """Return the line of event `index` from the log, without its line end."""
        assert self._file is not None
        first, end = self.index.positions[index : index + 2]
        try:
            text = os.pread(self._file.fileno(), end - first, first)
        except OSError as error:
            raise os_error(self._path, "read the session log", error) from error
        return text.partition(b"\n")[0]

    def content(self, index: int) -> str:
        """Return mission, kind and data of event `index` as one JSON object, as in the log.

        Equal texts mean equal events, whatever their times and sessions. Raises LogError if the log
        can no longer be read.
        """
        if self._file is None:
            event = self._held[index]
            data = event.data.model_dump(mode="json", exclude={"kind"})
            fields = {"mission": event.mission, "kind": event.data.kind, "data": data}
            return json.dumps(fields, ensure_ascii=False, separators=(",", ":"))
        line = self._line(index)
        first, end = line.find(_CONTENT), line.rfind(_LINKED)
        if min(first, end) < 0:
            raise LogError(str(self._path), 0, f"event {index + 1} has {_CHANGED}")
        return "{" + line[first + 1 : end].decode("utf-8", "replace") + "}"

    def of_mission(self, index: int) -> bool:
        """Return True if event `index` belongs to a mission."""
        return not self.timeline.is_telemetry(index) and self[index].mission is not None


class Player:
    """A player for one recording, at first paused at the beginning.

    The player has no clock, so the caller has to call `advance`. `state` is the session after the
    first `index` events. Most moves replace it, so read `state` again after every call. `position`
    is in seconds from the first event, by the events' own time stamps. If the log can no longer be
    read, every move raises LogError and takes the player back to the beginning.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.state = SessionState()
        self.index = 0
        self.position = 0.0
        self.playing = False
        self._rate = 1.0

    @classmethod
    def open(cls, path: Path, cache: Path | None = None, progress: Progress | None = None) -> Self:
        """Open the log at `path`; raises LogError if no event in it can be read.

        The index of a large log is saved in the folder `cache`. `progress` is called while the
        index is built.
        """
        return cls(Recording.read(path, progress, cache=cache))

    @classmethod
    def of(cls, events: Iterable[Event]) -> Self:
        """Return a player for events in memory."""
        return cls(Recording(events))

    @property
    def duration(self) -> float:
        """The time from the first event to the last, in seconds."""
        return self.recording.timeline.duration

    @property
    def finished(self) -> bool:
        """True after the last event."""
        return self.index == len(self.recording)

    @property
    def rate(self) -> float:
        """The number of recorded seconds per second of the viewer's time."""
        return self._rate

    @rate.setter
    def rate(self, rate: float) -> None:
        self._rate = min(max(rate, RATES[0]), RATES[-1])

    def play(self) -> None:
        """Start playing, from the beginning if the player is at the end."""
        if self.finished:
            self.seek(0.0)
        self.playing = True

    def pause(self) -> None:
        """Stop playing."""
        self.playing = False

    def advance(self, wall_s: float) -> frozenset[str]:
        """Let `wall_s` seconds of the viewer's time pass; return the kinds of the new events.

        The player pauses at the end.
        """
        if not self.playing:
            return frozenset()
        self.position = min(self.position + wall_s * self._rate, self.duration)
        first = self.index
        self._go_to(self.recording.timeline.count_until(self.position))
        self.playing = not self.finished
        return self.recording.timeline.kinds_between(first, self.index)

    def step(self) -> None:
        """Pause, and go to just after the next event."""
        self._step_to(self.index + 1)

    def step_back(self) -> None:
        """Pause, and go to just before the last event that was played."""
        self._step_to(self.index - 1)

    def step_seconds(self, seconds: float) -> None:
        """Pause, and go `seconds` of simulated time forward, or backward if negative.

        The player moves by at least one event. Without telemetry, the events' time stamps are used.
        """
        timeline = self.recording.timeline
        if timeline.ticks_per_s > 0:
            now = timeline.ticks[self.index - 1] if self.index else 0
            index = timeline.count_until_tick(now + seconds * timeline.ticks_per_s)
        else:
            index = timeline.count_until(self.position + seconds)
        least = self.index + (1 if seconds > 0 else -1)
        self._step_to(max(index, least) if seconds > 0 else min(index, least))

    def to_event(self, index: int) -> None:
        """Pause, and go to just after event `index`, counted from 0."""
        self._step_to(index + 1)

    def next_mark(self, kinds: frozenset[MarkKind]) -> bool:
        """Pause, and go to just after the next mark of these `kinds`; return False if none."""
        mark = self.recording.timeline.mark_after(self.index, kinds)
        if mark is not None:
            self.to_event(mark)
        return mark is not None

    def mark_back(self, kinds: frozenset[MarkKind]) -> bool:
        """Pause, and go to just after the previous mark of these `kinds`; return False if none."""
        mark = self.recording.timeline.mark_before(self.index - 1, kinds)
        if mark is not None:
            self.to_event(mark)
        return mark is not None

    def seek(self, seconds: float) -> None:
        """Go to `seconds` from the first event, or to the nearest end, without pausing."""
        self.position = min(max(seconds, 0.0), self.duration)
        self._go_to(self.recording.timeline.count_until(self.position))

    def _step_to(self, index: int) -> None:
        self.pause()
        index = min(max(index, 0), len(self.recording))
        self._go_to(index)
        self.position = self.recording.timeline.seconds[index - 1] if index else 0.0

    def _go_to(self, index: int) -> None:
        """Set `state` to the state after `index` events; only the last telemetry is read."""
        recording, timeline = self.recording, self.recording.timeline
        frame = recording.index.frame_before(index)
        # A keyframe helps if it lies ahead, or for a move backward; otherwise the fold continues.
        if index < self.index or frame > self.index:
            state, first, shown = recording.index.state_at(frame), frame, 0
        else:
            state, first, shown = self.state, self.index, self.index
        try:
            for number in timeline.without_telemetry(first, index):
                state.apply(recording[number])
            if (picture := timeline.last_telemetry(index)) >= shown:
                state.apply(recording[picture])
        except LogError:
            self.state, self.index, self.position = SessionState(), 0, 0.0
            self.playing = False
            raise
        if index:
            state.tick = timeline.ticks[index - 1]
        self.state, self.index = state, index
