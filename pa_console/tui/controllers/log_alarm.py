"""Shows on every screen that the session log cannot be written, until it can be again."""

from typing import Any

from textual.screen import Screen

from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.widgets.log_alarm import LogAlarm


class LogAlarmController:
    """Keeps a `LogAlarm` on each screen, those over the session's own included."""

    def __init__(self, session: ConsoleSession) -> None:
        self._session, self._app = session, session.app
        self._shown = ""

    def watch_screens(self) -> None:
        """Show it on every later screen, too."""
        self._app.screen_change_signal.subscribe(self._app, self._opened)

    def show(self) -> None:
        """Show the state of the log on all screens, if it has changed."""
        problem = self._session.folded.log_problem
        if problem != self._shown:
            self._shown = problem
            for screen in self._app.screen_stack:
                self._show_on(screen)

    def _opened(self, screen: Screen[Any]) -> None:
        if self._shown:
            screen.call_later(self._show_on, screen)  # once its own widgets are there

    def _show_on(self, screen: Screen[Any]) -> None:
        if not screen.is_running:
            return
        lines = screen.query_children(LogAlarm)
        if not self._shown:
            lines.remove()
        elif lines:
            lines.first().problem = self._shown
        else:
            screen.mount(LogAlarm(self._shown))
