"""Leaving the console: after confirmation if a mission would end, or when the terminal is gone."""

import asyncio
import signal
import sys
from contextlib import suppress

from textual.actions import SkipAction

from pa_console.end_signals import leave_terminal
from pa_console.tui.actions import action_of, shown_keys
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.settings import SettingsController
from pa_console.tui.terminal import when_hung_up

CLOSE_WITHIN_S = 3.0
"""The longest wait for the session to end before the console closes, in seconds."""


class LeavingController:
    """A controller that ends the session and then the console."""

    def __init__(self, session: ConsoleSession, settings: SettingsController) -> None:
        self._session, self._app, self._settings = session, session.app, settings
        self._loop: asyncio.AbstractEventLoop | None = None
        self.ended_by = 0
        """The number of the signal that ended the console, 0 for none."""
        self.takes_command = False
        """True if the console is to open again in command."""

    def watch_terminal(self) -> None:
        """Leave without confirmation once the terminal is gone."""
        self._loop = asyncio.get_running_loop()
        if self.ended_by:
            self._leave_unasked()
        if sys.__stdin__ is not None and not self._app.is_headless:
            when_hung_up(sys.__stdin__.fileno(), self._hung_up)

    def end(self, number: int) -> None:
        """Leave without confirmation because of the signal `number`; any thread may call this."""
        self.ended_by = number
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._app.call_later, self._leave_unasked)

    def _hung_up(self) -> None:
        leave_terminal()
        if not self.ended_by:
            self.end(signal.SIGHUP)

    def _leave_unasked(self) -> None:
        why = "the terminal is gone" if self.ended_by == signal.SIGHUP else "ended by SIGTERM"
        self._app.run_worker(self._close(why), exit_on_error=False)

    def leave(self) -> None:
        """Leave the console, after confirmation if this ends a mission or a standing order."""
        session, state = self._session, self._session.state
        ends: list[str] = []
        if state.active is not None:
            ends.append(f"Mission {state.active} is still active and will be cancelled.")
        ends += [
            f"Standing order {standing.order.id} is in force and will end: {standing.order.text}"
            for standing in state.standing.values()
            if standing.in_force
        ]
        if not ends or session.player is not None or session.readonly:
            self._leave_now()
            return
        question = "\n".join(["Leaving ends the session.", *ends])
        session.confirm(question, self._leave_now, yes="Leave", no="Stay")

    def _leave_now(self) -> None:
        self._app.run_worker(self._close(), exit_on_error=False)

    def take_command(self) -> None:
        """Leave to take command, after a dialog that describes the consequences."""
        joined = self._session.joined
        if joined is None or joined.command_question is None:
            return
        try:
            question = joined.command_question()
        except ValueError as error:
            self._session.tell(str(error), "Command not taken", bad=True)
            return

        def take() -> None:
            self.takes_command = True
            self._leave_now()

        self._session.confirm(question, take, yes="Take command", no="Only watch")

    def say_how(self) -> None:
        """Show, on any screen, how to leave; if text is selected, let the key copy it instead."""
        if getattr(self._app.focused, "selected_text", "") or self._app.screen.get_selected_text():
            raise SkipAction
        keys = shown_keys(action_of("quit"), self._settings.loaded.values.keys)
        back = "Esc goes back; there " if self._app.screen.is_modal else ""
        asks = "and asks first if that ends a mission or a standing order"
        self._session.tell(f"{back}{keys} leaves the console, {asks}", "Leave?")

    async def _close(self, reason: str = "closed by the operator") -> None:
        if self._session.station is not None:
            with suppress(Exception):
                await asyncio.wait_for(self._session.station.close(reason), CLOSE_WITHIN_S)
        self._app.exit()
