"""A recorded session held in memory as cheaply as a replay allows."""

from bisect import bisect_right
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Self

from pa_console.schema.event import Event
from pa_console.session.chain import LogError, parse
from pa_console.session.reader import read_lines

TELEMETRY = "telemetry"


class Recording:
    """The events of a session, with when each happened, in seconds from the first.

    Telemetry read from a log stays as the line it was, a fifth of the memory, until it is
    asked for. `problem` is where and why a log could not be read to its end.
    """

    def __init__(self, events: Iterable[Event] = ()) -> None:
        """Hold `events`, transient ones left out as a log leaves them out."""
        self.problem: LogError | None = None
        self._entries: list[Event | bytes] = []
        self._offsets: list[float] = []
        self._ticks: list[int] = []
        self._start: datetime | None = None
        for event in events:
            if not event.data.transient:
                self._add(event, event)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a log up to its first bad line; raises LogError when not even one line is good."""
        recording = cls()
        try:
            for number, line in read_lines(path):
                try:
                    event = parse(line).event
                except ValueError as error:
                    raise LogError(str(path), number, str(error)) from error
                if not event.data.transient:
                    recording._add(event, line if event.data.kind == TELEMETRY else event)
        except LogError as error:
            if not len(recording):
                raise
            recording.problem = error
        return recording

    def _add(self, event: Event, entry: Event | bytes) -> None:
        """Append; an event stamped before the one before it counts as simultaneous with it."""
        self._start = self._start or event.t
        offset = (event.t - self._start).total_seconds()
        self._offsets.append(max(offset, self.duration))
        self._ticks.append(event.tick)
        self._entries.append(entry)

    def __len__(self) -> int:
        return len(self._entries)

    def __getitem__(self, index: int) -> Event:
        entry = self._entries[index]
        return parse(entry).event if isinstance(entry, bytes) else entry

    @property
    def duration(self) -> float:
        """Seconds from the first event to the last."""
        return self._offsets[-1] if self._offsets else 0.0

    def offset(self, index: int) -> float:
        """Return when event `index` happened, in seconds from the first."""
        return self._offsets[index]

    def tick(self, index: int) -> int:
        """Return the simulation tick of event `index`."""
        return self._ticks[index]

    def count_until(self, seconds: float) -> int:
        """Return how many events had happened `seconds` after the first."""
        return bisect_right(self._offsets, seconds)

    def is_telemetry(self, index: int) -> bool:
        """Whether event `index` is telemetry, told without reading it."""
        entry = self._entries[index]
        return isinstance(entry, bytes) or entry.data.kind == TELEMETRY

    def of_mission(self, index: int) -> bool:
        """Whether event `index` tells of a mission's progress."""
        return not self.is_telemetry(index) and self[index].mission is not None
