"""A recorded session: its timeline in memory, the events themselves on the disk."""

import io
import json
import os
import weakref
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Self

from pa_console.schema.events.event import Event
from pa_console.session.log.chain import LogError, os_error, parse
from pa_console.session.replay.log_index import (
    LogIndex,
    Progress,
    build_index,
    identity,
    index_path,
    load_index,
    save_index,
)
from pa_console.session.replay.timeline import RecordingTimeline, mark_of
from pa_console.session.state.fold import SessionState

_CONTENT, _LINKED = b',"mission":', b',"prev":'
_CHANGED = "changed since the log was opened"
CACHED_FROM = 4_000_000
"""The least size in bytes of a log whose index is saved."""


class Recording:
    """The events of a session, each read from the log on access."""

    def __init__(self, events: Iterable[Event] = ()) -> None:
        """Hold `events` in memory; transient ones are left out, as a log leaves them out."""
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
        """Open a log up to its first bad line; raise LogError if not even one line is good.

        The index of a log of `cached_from` bytes or more is saved in the folder `cache`, if one is
        given and can be written. `frame_events` is the number of events between keyframes.
        """
        recording = cls()
        try:
            file = path.open("rb")
        except OSError as error:
            raise os_error(path, "read the session log", error) from error
        recording._path, recording._file = path, file
        weakref.finalize(recording, file.close)
        known = identity(file)
        kept = index_path(cache, path) if cache and known[2] >= cached_from else None
        index = load_index(kept, path, known) if kept else None
        if index is None:
            options = {"frame_events": frame_events} if frame_events is not None else {}
            try:
                index = build_index(path, file, known[2], progress, **options)
            except OSError as error:
                raise os_error(path, "read the session log", error) from error
            if kept is not None:
                with suppress(OSError):
                    save_index(kept, index, known)
        if index.problem is not None and not len(index.timeline):
            raise index.problem
        recording.index = index
        return recording

    @property
    def timeline(self) -> RecordingTimeline:
        """The time, kind and mark of every event."""
        return self.index.timeline

    @property
    def problem(self) -> LogError | None:
        """The error at which reading the log ended early."""
        return self.index.problem

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
        """Return the line of event `index` without its end, from the log."""
        assert self._file is not None
        first, end = self.index.positions[index : index + 2]
        try:
            found = os.pread(self._file.fileno(), end - first, first)
        except OSError as error:
            raise os_error(self._path, "read the session log", error) from error
        return found.partition(b"\n")[0]

    def content(self, index: int) -> str:
        """Return mission, kind and data of event `index` as one JSON object, as it is in the log.

        Equal texts are equal events, at any time and in any session. Raises LogError if the log
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

    @property
    def duration(self) -> float:
        """Seconds from the first event to the last."""
        return self.timeline.duration

    def offset(self, index: int) -> float:
        """Return the time of event `index`, in seconds from the first."""
        return self.timeline.seconds[index]

    def count_until(self, seconds: float) -> int:
        """Return the number of events up to `seconds` after the first."""
        return self.timeline.count_until(seconds)

    def is_telemetry(self, index: int) -> bool:
        """Return True if event `index` is telemetry; the event is not read for that."""
        return self.timeline.is_telemetry(index)

    def of_mission(self, index: int) -> bool:
        """Return True if event `index` belongs to a mission."""
        return not self.is_telemetry(index) and self[index].mission is not None
