"""Calls for the operator: signals that something waits, and a red line for a log fault.

A terminal ignores codes that it does not support.
"""

from collections.abc import Callable
from typing import Any

from textual.content import Content
from textual.screen import Screen
from textual.widgets import Static

from pa_console.schema.text import visible_line
from pa_console.station.alarms.waits import what_waits
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.settings import SettingsController

TITLE = "PA Console"

KEEP_TITLE = "\x1b[22;2t"
"""The code with which a terminal stores the title of its window."""

RESTORE_TITLE = "\x1b[23;2t"
"""The code with which a terminal restores the stored title."""

CLOSED = "LOG NOT WRITTEN: nothing is dispatched, no plan can be approved"


def notice(text: str) -> str:
    """Return the codes of a desktop notice: OSC 9 for some terminals, OSC 777 for others."""
    plain = visible_line(text).replace(";", ",")
    return f"\x1b]9;{TITLE}: {plain}\x07\x1b]777;notify;{TITLE};{plain}\x07"


def window_title(text: str = "") -> str:
    """Return the code that sets the window's title to `text` and the console's name."""
    plain = visible_line(text)
    return f"\x1b]2;▲ {plain} - {TITLE}\x07" if plain else f"\x1b]2;{TITLE}\x07"


class AttentionController:
    """The calls for the operator, made after a frame; the settings can switch off each kind."""

    def __init__(
        self, session: ConsoleSession, settings: SettingsController, write: Callable[[str], object]
    ) -> None:
        """Send codes to the terminal with `write`."""
        self._session, self._settings, self._write = session, settings, write
        self._waits: frozenset[str] = frozenset()
        self._title: str | None = None

    def look(self) -> None:
        """Call the operator for everything that has begun to wait since the previous look."""
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
        """Restore the window's own title."""
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
    """An alarm line that shows the consequence of an unwritable log, and the reason."""

    def show(self, problem: str) -> None:
        """Show the `problem` that the log reports."""
        self.update(Content.assemble((f"■ {CLOSED}", "bold"), f". {problem}"))


class LogAlarmController:
    """The `LogAlarm` on every screen, including screens opened over the main one."""

    def __init__(self, session: ConsoleSession) -> None:
        self._session, self._app = session, session.app
        self._shown = ""

    def watch_screens(self) -> None:
        """Show the alarm on screens that open later, too."""
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
            screen.call_later(self._show_on, screen)  # after its own widgets are mounted

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
