"""Moves about in the console: panes, map, pointers, and the screens with something to read."""

from pathlib import Path

from textual.binding import Binding

from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.settings import SettingsController
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.widgets.alarms import AlarmPane
from pa_console.tui.widgets.assets import AssetPane
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.mission_prompt import MissionPrompt


class BrowsingController:
    """Carries out what changes nothing outside the screen; it is legal everywhere."""

    def __init__(
        self,
        session: ConsoleSession,
        settings: SettingsController,
        evaluations: Path | None,
        copies: Path | None = None,
    ) -> None:
        """Open folders: `evaluations` is that of all evaluations, `copies` that of exports.

        None is the user's own.
        """
        self._copies = copies
        self._session, self._app = session, session.app
        self._settings, self._evaluations = settings, evaluations

    # Panes

    def view(self, view: str) -> None:
        """Go to a pane."""
        if self._session.shown is not None:
            self._session.shown.focus_view(view)

    def to_prompt(self) -> None:
        """Go to the mission field."""
        if self._session.shown is not None:
            self._session.shown.query_one(MissionPrompt).take_cursor()

    def leave_field(self) -> None:
        """Leave a field."""
        shown = self._session.shown
        if shown is not None and self._app.screen is shown:
            shown.leave_field()

    def select_mission(self, by: int) -> None:
        """Show the trace of the mission before or after."""
        if self._session.shown is not None:
            self._session.shown.select(self._session.shown_state, by)

    def next_alarm(self) -> None:
        """Put the pointer on the next alarm."""
        if self._session.shown is not None:
            self._session.shown.show_alarms().next_alarm()

    def next_queued(self) -> None:
        """Put the pointer on the next waiting mission."""
        if self._session.shown is not None:
            self._session.shown.show_alarms().next_mission()

    def ask_for_filter(self) -> None:
        """Type a filter for assets, tracks and cameras."""
        if self._session.shown is not None:
            self._session.shown.go_to("assets")
            self._session.shown.query_one(AssetPane).ask()

    def toggle_problems(self) -> None:
        """Show only what needs an eye, or everything."""
        if self._session.shown is not None:
            self._session.shown.go_to("assets")
            self._session.shown.query_one(AssetPane).toggle_problems()

    # The map

    def zoom(self, factor: float) -> None:
        """Zoom the map."""
        if self._session.shown is not None:
            self._session.shown.query_one(MapView).zoom_by(factor)

    def pan(self, right: int, up: int) -> None:
        """Move the map's view."""
        if self._session.shown is not None:
            self._session.shown.query_one(MapView).pan(right, up)

    def next_sensors(self) -> None:
        """Show on the map what cameras see, then what assets see too, then neither."""
        if self._session.shown is not None:
            self._session.shown.query_one(MapView).next_sensors()

    def follow_alarm(self) -> None:
        """Follow what the alarm at the pointer is about; the same again follows nothing."""
        shown = self._session.shown
        if shown is None:
            return
        view, subject = shown.query_one(MapView), shown.query_one(AlarmPane).subject
        if not subject or subject == view.followed:
            view.follow("")
        else:
            self.follow(subject)

    def follow(self, name: str) -> None:
        """Keep something in view on the map, and go to the map."""
        shown = self._session.shown
        if shown is not None:
            if shown.query_one(MapView).follow(name):
                shown.go_to("map")
            else:
                self._session.tell(f"where {name} is was never reported", "Follow", bad=True)

    # Screens over the session

    def show_help(self) -> None:
        """Show the help page."""
        from pa_console.tui.screens.help import HelpScreen  # noqa: PLC0415

        screen = self._app.screen
        given = () if isinstance(screen, MainScreen) else type(screen).BINDINGS
        here = [each for each in given if isinstance(each, Binding) and each.description]
        self._app.push_screen(HelpScreen(self._session.situation, self._settings.keys, here))

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
        from pa_console.tui.screens.evaluation import EvaluationScreen  # noqa: PLC0415
        from pa_console.tui.screens.questions import AskFolder  # noqa: PLC0415

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
            question = f"No evaluation below {below} yet: pa-console eval makes one.\nElsewhere?"
            self._app.push_screen(AskFolder(question), show)
