"""The feed of the session's events, which folds them and repaints the panes that they change."""

import asyncio
from collections.abc import Callable
from typing import cast

from pa_console.observability import Observer, unobserved
from pa_console.schema.events.event import Event
from pa_console.tui.actions import ActionContext, ActionHost, first_own_key
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.refresh import ALL_VIEWS, FRAME_S, is_open, views_of
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.surroundings import LiveStation
from pa_console.tui.widgets.map_view import MapView
from pa_console.views.waiting import Waiting, behind_line

LOOK_S = 1.0
"""The interval between two checks of the telemetry's age, in wall seconds."""


class SessionFeed:
    """The feed from a live station to the main screen, at most one frame every FRAME_S seconds."""

    def __init__(
        self,
        session: ConsoleSession,
        waiting: Waiting,
        folded: Callable[[Event], None],
        painted: Callable[[], None],
    ) -> None:
        """Call `folded` after each event, and `painted` after each frame.

        `waiting` describes the step that the session waits for.
        """
        self.waiting = waiting
        self._session, self._app = session, session.app
        self._folded, self._painted = folded, painted
        self._dirty: frozenset[str] = frozenset()
        self._flush_due = False
        self._last_telemetry = session.clock()
        self._situation = ActionContext()
        self._waited = False
        self.observer: Observer = unobserved
        """A callback that receives every event at once, even while the screen is busy."""

    def start(self) -> None:
        """Start to read the events; called after the first paint."""
        station = self._session.station
        if station is not None and self._session.player is None:
            self._app.run_worker(self._listen(station), group="session", exit_on_error=False)
            self._app.set_interval(LOOK_S, self.look)
        self.changed(ALL_VIEWS)

    async def _listen(self, station: LiveStation) -> None:
        """Read every event of the session; if the stream fails, the screen stays usable."""
        problem = ""
        try:
            async for event in station.run():
                self.observer(event)
                self._app.call_later(self.take, event)
                await asyncio.sleep(0)
        except Exception as error:  # after any error, the operator must keep the console
            problem = f"{type(error).__name__}: {error}"
        self._app.call_later(self.end, problem)

    def take(self, event: Event) -> None:
        """Fold one event, and mark the panes that it changes."""
        self._session.folded.apply(event)
        self.waiting.take(event, self._session.folded, self._session.clock())
        if event.data.kind == "telemetry":
            self._last_telemetry = self._session.clock()
        self.changed(views_of(event.data.kind))
        self._folded(event)

    def end(self, problem: str) -> None:
        """Repaint all panes at the end of the events, and show the `problem` if there is one."""
        if problem:
            self._app.notify(
                f"The session stopped: {problem}. Everything received so far stays "
                "readable; start the console again to continue.",
                title="No more events",
                severity="error",
                timeout=60,
                markup=False,
            )
        self.changed(ALL_VIEWS)

    def changed(self, views: frozenset[str]) -> None:
        """Repaint `views` in the next frame."""
        self._dirty |= views
        if not self._flush_due:
            self._flush_due = True
            self._app.set_timer(FRAME_S, self.flush)

    def flush(self) -> None:
        """Paint the next frame; a console that is closing has no screen left to paint."""
        self._flush_due = False
        if self._app.is_running:
            self._paint()
            self._painted()

    def _paint(self) -> None:
        """Repaint what has changed since the last frame."""
        session = self._session
        views, self._dirty = self._dirty, frozenset()
        if session.recording is not None:
            session.recording.repaint()
        main = self._main()
        if views and main is not None and session.player is None:
            silent = session.clock() - self._last_telemetry
            if session.station is not None and (ground := session.station.ground) is not None:
                main.query_one(MapView).lay(ground)
            main.refresh_views(session.state, views, session.rate, silent)
            self._show_waiting()
        self._tell_what_waits()
        if session.situation != self._situation:
            self._situation = session.situation
            self._app.refresh_bindings()

    def _main(self) -> MainScreen | None:
        """Return the main screen if all its widgets exist and it can be painted; else None."""
        main = self._session.main
        return main if main is not None and main.is_mounted and is_open(main) else None

    def _tell_what_waits(self) -> None:
        """Notify an operator on another screen that a plan has begun to wait."""
        session = self._session
        current = session.state.current
        waits = current is not None and current.approval is not None
        away = session.main is not None and self._app.screen is not session.main
        if waits and not self._waited and away and session.decides and not session.player:
            text = "A plan waits for your decision: Esc goes back to it"
            self._app.notify(text, title="Approval")
        self._waited = waits

    def _show_waiting(self) -> None:
        """Show on the main screen the running step, or the missions that wait for a decision."""
        main = self._main()
        if main is not None:
            session = self._session
            state = session.folded
            key = first_own_key("go_first", cast(ActionHost, self._app).keys)
            line = self.waiting.line(session.clock(), state, session.rate)
            main.show_waiting(line or behind_line(state, f"{key} lets it go first"))

    def look(self) -> None:
        """Update the age of the telemetry and the duration of the current step."""
        self._show_waiting()
        if self._session.clock() - self._last_telemetry > 4 * LOOK_S:
            self.changed(frozenset(("status",)))
