"""Plays a recorded session into the same state that a live one has."""

from collections.abc import Iterable
from pathlib import Path
from typing import Self

from pa_console.schema.event import Event
from pa_console.session.fold import SessionState
from pa_console.session.recording import Recording

RATES = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)


class Player:
    """A tape deck for one recording, paused at its beginning at first.

    It has no clock: whoever shows it calls `advance`. `state` is the session after the first
    `index` events; going backward makes a new one, so read `state` afresh after every call.
    `position` is in seconds from the first event, by the events' own time stamps.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.state = SessionState()
        self.index = 0
        self.position = 0.0
        self.playing = False
        self._rate = 1.0

    @classmethod
    def open(cls, path: Path) -> Self:
        """Load the log at `path`; raises LogError when nothing in it can be read."""
        return cls(Recording.read(path))

    @classmethod
    def of(cls, events: Iterable[Event]) -> Self:
        """Load events that are in memory."""
        return cls(Recording(events))

    @property
    def duration(self) -> float:
        """Seconds from the first event to the last."""
        return self.recording.duration

    @property
    def finished(self) -> bool:
        """Whether every event has been played."""
        return self.index == len(self.recording)

    @property
    def rate(self) -> float:
        """How many recorded seconds pass in one of the viewer's."""
        return self._rate

    @rate.setter
    def rate(self, rate: float) -> None:
        self._rate = min(max(rate, RATES[0]), RATES[-1])

    def play(self) -> None:
        """Let `advance` move on; from the end, start over."""
        if self.finished:
            self.seek(0.0)
        self.playing = True

    def pause(self) -> None:
        """Make `advance` stand still."""
        self.playing = False

    def advance(self, wall_s: float) -> tuple[Event, ...]:
        """Let `wall_s` seconds of the viewer's time pass; return the events that came up.

        At the end the player pauses by itself.
        """
        if not self.playing:
            return ()
        self.position = min(self.position + wall_s * self._rate, self.duration)
        first, self.index = self.index, self.recording.count_until(self.position)
        events = tuple(self.recording[index] for index in range(first, self.index))
        for event in events:
            self.state.apply(event)
        self.playing = not self.finished
        return events

    def step(self) -> None:
        """Pause, and go to just after the next event."""
        self._step_to(self.index + 1)

    def step_back(self) -> None:
        """Pause, and go to just before the last event that was played."""
        self._step_to(self.index - 1)

    def step_mission(self) -> None:
        """Pause, and go to just after the next event of a mission, or to the end."""
        ahead = range(self.index, len(self.recording))
        found = next((index for index in ahead if self.recording.of_mission(index)), ahead.stop)
        self._step_to(found + 1)

    def step_mission_back(self) -> None:
        """Pause, and go to just after the previous event of a mission, or to the beginning."""
        behind = range(self.index - 2, -1, -1)
        found = next((index for index in behind if self.recording.of_mission(index)), -1)
        self._step_to(found + 1)

    def step_seconds(self, seconds: float) -> None:
        """Go `seconds` forward, or backward when negative."""
        self.seek(self.position + seconds)

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
        """Make `state` that after `index` events; of skipped telemetry only the last is read."""
        if index < self.index:
            self.state, self.index = SessionState(), 0
        span = range(self.index, index)
        last = next((i for i in reversed(span) if self.recording.is_telemetry(i)), None)
        for i in span:
            if i == last or not self.recording.is_telemetry(i):
                self.state.apply(self.recording[i])
            else:
                self.state.tick = max(self.state.tick, self.recording.tick(i))
        self.index = index
