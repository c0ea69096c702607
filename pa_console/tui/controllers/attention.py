"""Calls the operator: bell, notice and window title for what waits, a red line for a lost log.

A terminal that does not know a code ignores it.
"""

from collections.abc import Callable
from typing import Any

from textual.content import Content
from textual.screen import Screen
from textual.widgets import Static

from pa_console.schema.text import visible_line
from pa_console.station.waits import what_waits
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.settings import SettingsController

TITLE = "PA Console"

KEEP_TITLE = "\x1b[22;2t"
"""Has the terminal remember the title that its window has."""

RESTORE_TITLE = "\x1b[23;2t"
"""Has it take that title again."""

CLOSED = "LOG NOT WRITTEN: nothing is dispatched, no plan can be approved"


def notice(text: str) -> str:
    """Return the codes of a desktop notice: OSC 9 for some terminals, OSC 777 for others."""
    plain = visible_line(text).replace(";", ",")
    return f"\x1b]9;{TITLE}: {plain}\x07\x1b]777;notify;{TITLE};{plain}\x07"


def window_title(text: str = "") -> str:
    """Return the code that names the window: what waits, or the console alone."""
    plain = visible_line(text)
    return f"\x1b]2;▲ {plain} - {TITLE}\x07" if plain else f"\x1b]2;{TITLE}\x07"


class AttentionController:
    """Looks at the session after each frame; every means can be switched off in the settings."""

    def __init__(
        self, session: ConsoleSession, settings: SettingsController, write: Callable[[str], object]
    ) -> None:
        """`write` sends codes to the terminal."""
        self._session, self._settings, self._write = session, settings, write
        self._waits: frozenset[str] = frozenset()
        self._title: str | None = None

    def look(self) -> None:
        """Notify of plans that have begun to wait since the last look."""
        session, write = self._session, self._write
        if session.player is not None or not session.decides:
            return
        now = what_waits(session.folded)
        new = [wait.text for key, wait in now.items() if key not in self._waits]
        self._waits = frozenset(now)
        values = self._settings.loaded.values
        if new and values.bell:
            write("\a")
        if new and values.desktop_notices:
            write(notice("; ".join(new)))
        title = next((wait.text for wait in now.values()), "")
        self._name_window(title, wanted=values.window_title)

    def leave(self) -> None:
        """Give the window its own title back."""
        if self._title is not None:
            self._write(RESTORE_TITLE)
            self._title = None

    def _name_window(self, title: str, *, wanted: bool) -> None:
        if not wanted:
            self.leave()
        elif title != self._title:
            first = KEEP_TITLE if self._title is None else ""
            self._title = title
            self._write(first + window_title(title))


class LogAlarm(Static):
    """The consequence for the operator, and then why the log cannot be written."""

    def show(self, problem: str) -> None:
        """Show the log's own text about its problem."""
        self.update(Content.assemble((f"■ {CLOSED}", "bold"), f". {problem}"))


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
            return
        if not lines:
            screen.mount(LogAlarm())
        for line in screen.query_children(LogAlarm):
            line.show(self._shown)
