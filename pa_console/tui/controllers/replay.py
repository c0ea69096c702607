"""Moves a recording, searches it and compares it with another one."""

from functools import partial
from pathlib import Path

from pa_console.schema.document import DocumentError
from pa_console.session.log_index import Progress
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.replay.deck import FINDINGS, MISSIONS
from pa_console.tui.replay.position import ACCEPTED, read_position


class ReplayController:
    """Carries out what only a recording has."""

    def __init__(self, session: ConsoleSession) -> None:
        self._session, self._app = session, session.app

    def play_pause(self) -> None:
        """Play or pause."""
        if self._session.recording is not None:
            self._session.recording.move(lambda deck: deck.play_pause())

    def step(self, by: int) -> None:
        """One event forward or back."""
        if self._session.recording is not None:
            self._session.recording.move(lambda deck: deck.step(by))

    def step_second(self, by: int) -> None:
        """One simulated second forward or back."""
        if self._session.recording is not None:
            self._session.recording.move(lambda deck: deck.step_second(by))

    def jump_mission(self, by: int) -> None:
        """Jump to the beginning of the next mission, or the one before."""
        if self._session.recording is not None:
            self._session.recording.jump(MISSIONS, by, "mission")

    def jump_finding(self, by: int) -> None:
        """Jump to the next finding, override, alarm, refusal or fault, or the one before."""
        if self._session.recording is not None:
            what = "finding, override, alarm, refusal or fault"
            self._session.recording.jump(FINDINGS, by, what)

    def to_moment(self) -> None:
        """Ask for a moment and go there."""
        recording = self._session.recording
        if recording is None:
            return
        from pa_console.tui.screens.questions import AskLine  # noqa: PLC0415

        def given(index: int | None) -> None:
            if index is not None:
                recording.move(lambda deck: deck.to_event(index - 1))

        def read(text: str) -> int:
            return read_position(text, recording.player)

        self._app.push_screen(AskLine("Where to?", ACCEPTED, read), given)

    def search(self) -> None:
        """Search the recording and jump to the choice."""
        recording = self._session.recording
        if recording is None:
            return
        from pa_console.tui.screens.find_event import FindEvent  # noqa: PLC0415

        def chosen(index: int | None) -> None:
            if index is not None:
                recording.move(lambda deck: deck.to_event(index))

        screen = FindEvent(recording.player.recording, recording.player.index)
        self._app.push_screen(screen, chosen)

    def compare(self) -> None:
        """Ask for another recording and show where it differs from this one."""
        recording = self._session.recording
        if recording is None:
            return
        from pa_console.tui.replay.recordings import KnownWorld, open_compared  # noqa: PLC0415
        from pa_console.tui.screens.compare import CompareScreen, Side  # noqa: PLC0415
        from pa_console.tui.screens.opening_log import OpeningLog, is_large  # noqa: PLC0415
        from pa_console.tui.screens.questions import AskLine  # noqa: PLC0415

        def opened(path: Path, progress: Progress | None = None) -> Side:
            known = KnownWorld.of(recording.world, recording.player.recording)
            return Side.of(path.name, open_compared(path, known, progress))

        def read(text: str) -> Side | Path:
            path = Path(text).expanduser()
            if not path.is_file():
                raise ValueError(f"{path}: there is no such log")
            try:
                return path if is_large(path) else opened(path)
            except (DocumentError, OSError) as error:
                raise ValueError(str(error)) from error

        def given(other: Side | Path | None) -> None:
            if isinstance(other, Path):
                self._app.push_screen(OpeningLog(other, partial(opened, other)), given)
            elif other is not None:
                own = Side("this one", recording.player.recording, recording.world, recording.rules)
                self._app.push_screen(CompareScreen(own, other, self._session.clock))

        question = "Which session log is to be compared with this one?"
        self._app.push_screen(AskLine(question, "Enter compares, Esc goes back", read), given)
