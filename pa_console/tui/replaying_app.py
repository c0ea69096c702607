"""The half of the app that moves a recording, searches it and compares it with another one."""

from functools import partial
from pathlib import Path

from pa_console.schema.document import DocumentError
from pa_console.session.replay.log_index import Progress
from pa_console.tui.browsing_app import BrowsingApp
from pa_console.tui.replay_driver import FINDINGS, MISSIONS
from pa_console.tui.replay_position import ACCEPTED, read_position


class ReplayingApp(BrowsingApp):
    """Carries out the registry's actions that only a recording has."""

    def action_play_pause(self) -> None:
        """Play or pause."""
        if self.recording is not None:
            self.recording.move(lambda deck: deck.play_pause())

    def action_step(self, by: int) -> None:
        """One event forward or back."""
        if self.recording is not None:
            self.recording.move(lambda deck: deck.step(by))

    def action_step_second(self, by: int) -> None:
        """One simulated second forward or back."""
        if self.recording is not None:
            self.recording.move(lambda deck: deck.step_second(by))

    def action_jump_mission(self, by: int) -> None:
        """To where the next mission begins, or the one before."""
        if self.recording is not None:
            self.recording.jump(MISSIONS, by, "mission")

    def action_jump_finding(self, by: int) -> None:
        """To the next finding, override, alarm, refusal or fault, or the one before."""
        if self.recording is not None:
            self.recording.jump(FINDINGS, by, "finding, override, alarm, refusal or fault")

    def action_to_moment(self) -> None:
        """Ask for a moment and go there."""
        recording = self.recording
        if recording is None:
            return
        from pa_console.tui.screens.questions import AskLine  # noqa: PLC0415

        def given(index: int | None) -> None:
            if index is not None:
                recording.move(lambda deck: deck.to_event(index - 1))

        def read(text: str) -> int:
            return read_position(text, recording.player)

        self.push_screen(AskLine("Where to?", ACCEPTED, read), given)

    def action_search_log(self) -> None:
        """Search the recording and go to what was chosen."""
        recording = self.recording
        if recording is None:
            return
        from pa_console.tui.screens.find_event import FindEvent  # noqa: PLC0415

        def chosen(index: int | None) -> None:
            if index is not None:
                recording.move(lambda deck: deck.to_event(index))

        self.push_screen(FindEvent(recording.player.recording, recording.player.index), chosen)

    def action_compare(self) -> None:
        """Ask for another recording and show where it differs from this one."""
        recording = self.recording
        if recording is None:
            return
        from pa_console.tui.recordings import KnownWorld, open_compared  # noqa: PLC0415
        from pa_console.tui.screens.compare import CompareScreen, Side  # noqa: PLC0415
        from pa_console.tui.screens.opening_log import ReadingLog, is_large  # noqa: PLC0415
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
                self.push_screen(ReadingLog(other, partial(opened, other)), given)
            elif other is not None:
                own = Side("this one", recording.player.recording, recording.world, recording.rules)
                self.push_screen(CompareScreen(own, other, self.clock))

        question = "Which session log is to be compared with this one?"
        self.push_screen(AskLine(question, "Enter compares, Esc goes back", read), given)
