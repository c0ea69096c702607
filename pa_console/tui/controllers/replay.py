"""Moves a recording, by keys or to a typed position, searches it and compares it with another."""

import re
from collections.abc import Callable
from datetime import timedelta
from functools import partial
from pathlib import Path

from pa_console.schema.document import DocumentError
from pa_console.session.log_index import Progress
from pa_console.session.recording import Player
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.screens.recording import FINDINGS, MISSIONS, RecordingScreen

ACCEPTED = (
    "1:30 into the recording   s1:30 the session's own clock   @14:05:30 the time of day\n"
    "+30 -30 seconds from here   #120 event 120   50% of it   end"
)
"""The accepted forms, for the operator."""


def read_position(text: str, player: Player) -> int:
    """Return the number of events played by the moment that `text` names.

    Raises ValueError with the valid forms.
    """
    timeline, text = player.recording.timeline, "".join(text.split()).lower()
    if text == "end":
        return len(timeline)
    if found := re.fullmatch(r"#(\d{1,12})", text):
        return min(int(found[1]), len(timeline))
    if (found := re.fullmatch(r"(\d{1,3}(?:\.\d+)?)%", text)) and float(found[1]) <= 100:
        return timeline.count_until(timeline.duration * float(found[1]) / 100)
    found = re.fullmatch(r"([-+s@]?)((?:\d{1,6}:){0,2}\d{1,6}(?:\.\d+)?)", text)
    if found is None:
        raise ValueError(f"“{text}” is no moment; write one like these:\n{ACCEPTED}")
    sign, seconds = found[1], _seconds(found[2])
    if sign == "s":
        if not timeline.ticks_per_s:
            raise ValueError("this recording has no telemetry, so it knows no clock of its own")
        return timeline.count_until_tick(seconds * timeline.ticks_per_s)
    if sign == "@":
        return timeline.count_until(_since_start(seconds, player))
    if sign:
        return timeline.count_until(player.position + (seconds if sign == "+" else -seconds))
    return timeline.count_until(seconds)


def _seconds(text: str) -> float:
    total = 0.0
    for part in text.split(":"):
        total = 60 * total + float(part)
    return total


def _since_start(time_of_day: float, player: Player) -> float:
    """Return the seconds from the first event to the next time that the clock shows this (UTC)."""
    start = player.recording.timeline.start
    if start is None:
        return 0.0
    midnight = start.replace(hour=0, minute=0, second=0, microsecond=0)
    passed = (midnight + timedelta(seconds=time_of_day) - start).total_seconds()
    return passed if passed >= 0 else passed + timedelta(days=1).total_seconds()


class ReplayController:
    """Carries out what only a recording has."""

    def __init__(self, session: ConsoleSession) -> None:
        self._session, self._app = session, session.app

    def with_recording(self, act: Callable[[RecordingScreen], object]) -> None:
        """Act on the recording that is looked at, if one is."""
        if self._session.recording is not None:
            act(self._session.recording)

    def move(self, how: Callable[[Player], object]) -> None:
        """Move the recording that is looked at."""
        self.with_recording(lambda recording: recording.move(how))

    def jump_mission(self, by: int) -> None:
        """Jump to the beginning of the next mission, or the one before."""
        self.with_recording(lambda recording: recording.jump(MISSIONS, by, "mission"))

    def jump_finding(self, by: int) -> None:
        """Jump to the next finding, override, alarm, refusal or fault, or the one before."""
        what = "finding, override, alarm, refusal or fault"
        self.with_recording(lambda recording: recording.jump(FINDINGS, by, what))

    def to_moment(self) -> None:
        """Ask for a moment and go there."""
        recording = self._session.recording
        if recording is None:
            return
        from pa_console.tui.screens.dialogs import AskLine  # noqa: PLC0415

        def given(index: int | None) -> None:
            if index is not None:
                recording.move(lambda player: player.to_event(index - 1))

        def read(text: str) -> int:
            return read_position(text, recording.player)

        self._app.push_screen(AskLine("Where to?", ACCEPTED, read), given)

    def search(self) -> None:
        """Search the recording and jump to the choice."""
        recording = self._session.recording
        if recording is None:
            return
        from pa_console.tui.screens.recording import FindEvent  # noqa: PLC0415

        def chosen(index: int | None) -> None:
            if index is not None:
                recording.move(lambda player: player.to_event(index))

        screen = FindEvent(recording.player.recording, recording.player.index)
        self._app.push_screen(screen, chosen)

    def compare(self) -> None:
        """Ask for another recording and show where it differs from this one."""
        recording = self._session.recording
        if recording is None:
            return
        from pa_console.tui.recordings import KnownWorld, OpenedLog, open_compared  # noqa: PLC0415
        from pa_console.tui.screens.compare import CompareScreen  # noqa: PLC0415
        from pa_console.tui.screens.dialogs import AskLine, OpeningLog, is_large  # noqa: PLC0415

        known = KnownWorld.of(recording.world, recording.player.recording)

        def opened(path: Path, progress: Progress | None = None) -> OpenedLog:
            return open_compared(path, known, progress)

        def read(text: str) -> OpenedLog | Path:
            path = Path(text).expanduser()
            if not path.is_file():
                raise ValueError(f"{path}: there is no such log")
            try:
                return path if is_large(path) else opened(path)
            except (DocumentError, OSError) as error:
                raise ValueError(str(error)) from error

        def given(other: OpenedLog | Path | None) -> None:
            if isinstance(other, Path):
                self._app.push_screen(OpeningLog(other, partial(opened, other)), given)
            elif other is not None:
                own = OpenedLog(
                    "this one", recording.player.recording, recording.world, recording.rules
                )
                self._app.push_screen(CompareScreen(own, other, self._session.clock))

        question = "Which session log is to be compared with this one?"
        self._app.push_screen(AskLine(question, "Enter compares, Esc goes back", read), given)
