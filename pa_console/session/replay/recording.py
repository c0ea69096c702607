"""A recorded session: when everything happened in memory, the events themselves on the disk."""

import io
import json
import os
import weakref
from bisect import bisect_right
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Self

from pa_console.schema.events.event import Event
from pa_console.session.log.chain import LogError, os_error, parse
from pa_console.session.replay.keyframe import unpack_mission, unpack_state
from pa_console.session.replay.log_index import (
    LogIndex,
    Progress,
    build_index,
    identity,
    index_path,
    load_index,
    save_index,
)
from pa_console.session.replay.timeline import Timeline, mark_of
from pa_console.session.state.fold import SessionState
from pa_console.session.state.mission_trace import MissionTrace

_SAID, _LINKED = b',"mission":', b',"prev":'
_CHANGED = "changed since the log was opened"
CACHED_FROM = 4_000_000
"""The index of a log of at least so many bytes is worth keeping."""


class Recording:
    """The events of a session, each read from the log when it is asked for.

    `problem` is where and why the log could not be read to its end.
    """

    def __init__(self, events: Iterable[Event] = ()) -> None:
        """Hold `events` in memory, transient ones left out as a log leaves them out."""
        self._held: list[Event] = []
        self._index = LogIndex(io.BytesIO())
        self._path, self._file = Path(), None
        self._packs: dict[str, list[int]] | None = None
        state = SessionState()
        for event in events:
            if not event.data.transient:
                mark = mark_of(event, state)
                state.apply(event)
                self.timeline.add(event.t, event.tick, event.data.kind, mark)
                if event.data.kind == "telemetry" and event.data.picture.time_s > 0:
                    picture = event.data.picture
                    self.timeline.ticks_per_s = picture.tick / picture.time_s
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
        """Open a log up to its first bad line; raises LogError when not even one line is good.

        The index of a log of `cached_from` bytes or more is kept in the folder `cache`, if one is
        given and takes it. `frame_events` is how far apart keyframes are.
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
        recording._index = index
        return recording

    @property
    def timeline(self) -> Timeline:
        """When every event happened, of which kind it is, and which ones are marked."""
        return self._index.timeline

    @property
    def problem(self) -> LogError | None:
        """Where and why the log could not be read to its end."""
        return self._index.problem

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
        first, end = self._index.positions[index : index + 2]
        try:
            found = os.pread(self._file.fileno(), end - first, first)
        except OSError as error:
            raise os_error(self._path, "read the session log", error) from error
        return found.partition(b"\n")[0]

    def said(self, index: int) -> str:
        """Return mission, kind and data of event `index` as one JSON object, as it is in the log.

        Equal texts are equal events, whenever, in whatever session and after whatever they came.
        Raises LogError when the log cannot be read any more.
        """
        if self._file is None:
            event = self._held[index]
            data = event.data.model_dump(mode="json", exclude={"kind"})
            fields = {"mission": event.mission, "kind": event.data.kind, "data": data}
            return json.dumps(fields, ensure_ascii=False, separators=(",", ":"))
        line = self._line(index)
        first, end = line.find(_SAID), line.rfind(_LINKED)
        if min(first, end) < 0:
            raise LogError(str(self._path), 0, f"event {index + 1} has {_CHANGED}")
        return "{" + line[first + 1 : end].decode("utf-8", "replace") + "}"

    @property
    def duration(self) -> float:
        """Seconds from the first event to the last."""
        return self.timeline.duration

    def offset(self, index: int) -> float:
        """Return when event `index` happened, in seconds from the first."""
        return self.timeline.seconds[index]

    def count_until(self, seconds: float) -> int:
        """Return how many events had happened `seconds` after the first."""
        return self.timeline.count_until(seconds)

    def is_telemetry(self, index: int) -> bool:
        """Whether event `index` is telemetry, told without reading it."""
        return self.timeline.is_telemetry(index)

    def of_mission(self, index: int) -> bool:
        """Whether event `index` tells of a mission's progress."""
        return not self.is_telemetry(index) and self[index].mission is not None

    def frame_before(self, count: int) -> int:
        """Return the event count of the last keyframe of at most `count` events; 0 is the start."""
        place = bisect_right(self._index.frames, count)
        return self._index.frames[place - 1] if place else 0

    def state_at_frame(self, count: int) -> SessionState:
        """Return the session, but for its picture, at the keyframe of `count` events."""
        if not count:
            return SessionState()
        index = self._index
        frame = bisect_right(index.frames, count) - 1
        packed = index.blob(index.frame_at[frame], index.frame_size[frame])

        def load(name: str) -> MissionTrace:
            return self._mission_at(name, frame)

        return unpack_state(packed, index.missions, load)

    def _mission_at(self, name: str, frame: int) -> MissionTrace:
        """Return a mission as it was at keyframe number `frame`."""
        index = self._index
        if self._packs is None:
            self._packs = {known: [] for known in index.missions}
            for pack, mission in enumerate(index.pack_mission):
                self._packs[index.missions[mission]].append(pack)
        packs = self._packs[name]
        at = packs[bisect_right(packs, frame, key=index.pack_frame.__getitem__) - 1]
        return unpack_mission(index.blob(index.pack_at[at], index.pack_size[at]))
