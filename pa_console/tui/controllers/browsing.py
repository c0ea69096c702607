"""Navigation in the console: panes, the map, screens to read, and copies."""

from datetime import datetime
from pathlib import Path

from textual.binding import Binding

from pa_console.schema.text import visible
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.settings import SettingsController
from pa_console.tui.kept_input import export_folder, write_copy
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.widgets.alarms import AlarmPane
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.trace_pane import trace_text


class BrowsingController:
    """Actions that do not affect the session; they are legal everywhere."""

    def __init__(
        self,
        session: ConsoleSession,
        settings: SettingsController,
        evaluations: Path | None,
        copies: Path | None = None,
    ) -> None:
        """Use `evaluations` as the folder of all evaluations, and `copies` as the export folder.

        None means the user's own folder.
        """
        self._copies = copies
        self._session, self._app = session, session.app
        self._settings, self._evaluations = settings, evaluations

    # Panes and the map

    def leave_field(self) -> None:
        """Leave a field of the shown session."""
        shown = self._session.shown
        if shown is not None and self._app.screen is shown:
            shown.leave_field()

    def select_mission(self, by: int) -> None:
        """Show the trace of the previous or the next mission."""
        if self._session.shown is not None:
            self._session.shown.select(self._session.shown_state, by)

    def follow_alarm(self) -> None:
        """Follow the subject of the alarm at the pointer, or stop if it is followed already."""
        shown = self._session.shown
        if shown is None:
            return
        view, subject = shown.query_one(MapView), shown.query_one(AlarmPane).subject
        if not subject or subject == view.followed:
            view.follow("")
        else:
            self.follow(subject)

    def follow(self, name: str) -> None:
        """Keep the item `name` in view on the map, and show the map."""
        shown = self._session.shown
        if shown is not None:
            if shown.query_one(MapView).follow(name):
                shown.go_to("map")
            else:
                self._session.tell(f"no position of {name} was ever reported", "Follow", bad=True)

    # Screens over the session

    def show_help(self) -> None:
        """Show the help page."""
        from pa_console.tui.screens.manual import HelpScreen, help_rows  # noqa: PLC0415

        screen = self._app.screen
        given = () if isinstance(screen, MainScreen) else type(screen).BINDINGS
        here = [
            binding for binding in given if isinstance(binding, Binding) and binding.description
        ]
        rows = help_rows(self._session.situation, self._settings.keys, here)
        self._app.push_screen(HelpScreen(rows))

    def show_manual(self) -> None:
        """Show the manual."""
        from pa_console.manual_pages import load_manual  # noqa: PLC0415
        from pa_console.tui.screens.manual import ManualScreen  # noqa: PLC0415

        if not self._session.is_open(ManualScreen):
            self._app.push_screen(ManualScreen(load_manual()))

    def show_sessions(self) -> None:
        """Show the recorded sessions."""
        from pa_console.session.log.writer import default_folder  # noqa: PLC0415
        from pa_console.tui.screens.sessions import SessionsScreen  # noqa: PLC0415

        if not self._session.is_open(SessionsScreen):
            folder = self._settings.loaded.values.logs or default_folder()
            self._app.push_screen(SessionsScreen(folder, self._session.clock, self._copies))

    def show_evaluation(self) -> None:
        """Show the newest evaluation, or ask for the folder of one."""
        from pa_console.evaluation.run_record import evaluations_folder, newest_evaluation  # noqa: PLC0415
        from pa_console.tui.screens.dialogs import AskFolder  # noqa: PLC0415
        from pa_console.tui.screens.evaluation import EvaluationScreen  # noqa: PLC0415

        if self._session.is_open(EvaluationScreen):
            return

        def show(folder: Path | None) -> None:
            if folder is not None:
                self._app.push_screen(EvaluationScreen(folder, self._session.clock))

        below = self._evaluations or evaluations_folder()
        newest = newest_evaluation(below)
        if newest is not None:
            show(newest)
        else:
            question = f"No evaluation in {below}; pa-console eval makes one.\nOpen another folder:"
            self._app.push_screen(AskFolder(question), show)

    # Copies

    def copy_trace(self) -> None:
        """Copy the shown trace to the terminal's clipboard and to a file."""
        shown, trace = self._session.shown, self._shown_trace
        if shown is not None and trace is not None:
            text = trace_text(trace, shown.rules)
            self._copy("trace", f"{trace.mission.id}-trace.txt", text)

    def copy_plan(self) -> None:
        """Copy the shown plan to the terminal's clipboard and to a file."""
        trace = self._shown_trace
        if trace is not None:
            self._copy("plan", f"{trace.mission.id}-plan.json", _plan_text(trace))

    def take_screenshot(self) -> None:
        """Write a screenshot to an SVG file, after the palette is closed."""

        def take() -> None:
            screenshot = self._app.export_screenshot(title=self._app.title)
            name = f"screen-{datetime.now():%Y%m%d-%H%M%S}.svg"
            where = write_copy(self._copies or export_folder(), name, screenshot)
            self._session.tell(str(where), "Screenshot")

        self._app.call_after_refresh(take)

    @property
    def _shown_trace(self) -> MissionTrace | None:
        shown = self._session.shown
        return shown.selected(self._session.shown_state) if shown is not None else None

    def _copy(self, kind: str, file: str, text: str) -> None:
        self._app.copy_to_clipboard(visible(text))
        where = write_copy(self._copies or export_folder(), file, text)
        self._session.tell(f"{where}, and sent to the terminal's clipboard", f"Copied the {kind}")


def _plan_text(trace: MissionTrace) -> str:
    """Return the JSON of the latest plan that could be read, or else the model's last answer."""
    from pa_console.tui.screens.plan_editing import plan_json  # noqa: PLC0415

    for attempt in reversed(trace.attempts):
        if attempt.plan is not None:
            return plan_json(attempt.plan)
    return trace.attempts[-1].text if trace.attempts else ""
