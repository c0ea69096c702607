"""The player of a recorded session, which has the same state as a live one."""

from collections.abc import Iterable
from pathlib import Path
from typing import Self

from pa_console.schema.events.event import Event
from pa_console.session.log.chain import LogError
from pa_console.session.replay.log_index import Progress
from pa_console.session.replay.recording import Recording
from pa_console.session.replay.timeline import MarkKind
from pa_console.session.state.fold import SessionState

RATES = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)


class Player:
    """A tape deck for one recording, paused at its beginning at first.

    It has no clock: its caller calls `advance`. `state` is the session after the first `index`
    events; most moves make a new one, so read `state` afresh after every call. `position` is in
    seconds from the first event, by the events' own time stamps. Every move raises LogError if the
    log can no longer be read; the player is then back at the beginning.
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
        """Open the log at `path`; raise LogError if nothing in it can be read.

        The index of a large log is saved in the folder `cache`; `progress` gets the bytes read.
        """
        return cls(Recording.read(path, progress, cache=cache))

    @classmethod
    def of(cls, events: Iterable[Event]) -> Self:
        """Return a player of events that are in memory."""
        return cls(Recording(events))

    @property
    def duration(self) -> float:
        """Seconds from the first event to the last."""
        return self.recording.duration

    @property
    def finished(self) -> bool:
        """True after the last event."""
        return self.index == len(self.recording)

    @property
    def rate(self) -> float:
        """Recorded seconds in one second of the viewer."""
        return self._rate

    @rate.setter
    def rate(self, rate: float) -> None:
        self._rate = min(max(rate, RATES[0]), RATES[-1])

    def play(self) -> None:
        """Let `advance` move; from the end, start over."""
        if self.finished:
            self.seek(0.0)
        self.playing = True

    def pause(self) -> None:
        """Make `advance` stand still."""
        self.playing = False

    def advance(self, wall_s: float) -> frozenset[str]:
        """Let `wall_s` seconds of the viewer's time pass; return the kinds of what came up.

        At the end the player pauses by itself.
        """
        if not self.playing:
            return frozenset()
        self.position = min(self.position + wall_s * self._rate, self.duration)
        first = self.index
        self._go_to(self.recording.count_until(self.position))
        self.playing = not self.finished
        return self.recording.timeline.kinds_between(first, self.index)

    def step(self) -> None:
        """Pause, and go to just after the next event."""
        self._step_to(self.index + 1)

    def step_back(self) -> None:
        """Pause, and go to just before the last event that was played."""
        self._step_to(self.index - 1)

    def step_seconds(self, seconds: float) -> None:
        """Pause, and go `seconds` of the simulation forward, or backward when negative.

        The player moves by at least one event. Without telemetry, the events' own seconds count.
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
        """Pause, and go to just after the next mark of these `kinds`; return False without one."""
        found = self.recording.timeline.mark_after(self.index, kinds)
        if found is not None:
            self.to_event(found)
        return found is not None

    def mark_back(self, kinds: frozenset[MarkKind]) -> bool:
        """Pause, and go to just after the mark before; return False without one."""
        found = self.recording.timeline.mark_before(self.index - 1, kinds)
        if found is not None:
            self.to_event(found)
        return found is not None

    def seek(self, seconds: float) -> None:
        """Go to `seconds` from the first event, or to the nearer end; playing goes on."""
        self.position = min(max(seconds, 0.0), self.duration)
        self._go_to(self.recording.count_until(self.position))

    def _step_to(self, index: int) -> None:
        self.pause()
        index = min(max(index, 0), len(self.recording))
        self._go_to(index)
        self.position = self.recording.offset(index - 1) if index else 0.0

    def _go_to(self, index: int) -> None:
        """Make `state` that after `index` events; of skipped telemetry, only the last is read."""
        recording, timeline = self.recording, self.recording.timeline
        frame = recording.index.frame_before(index)
        # A keyframe helps backward, or beyond the present event; else the fold goes on from here.
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
