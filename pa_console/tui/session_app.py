"""The half of the app that faces the session: takes events in, folds them, repaints panes."""

import asyncio
import time
from collections.abc import Sequence

from textual.app import App
from textual.filter import LineFilter
from textual.message import Message
from textual.widgets import Input, TextArea

from pa_console.schema.events.event import Event
from pa_console.schema.world import World
from pa_console.session.replay.player import Player
from pa_console.session.state.fold import SessionState
from pa_console.tui.actions import ActionContext, find_action
from pa_console.tui.plain_output import PlainConsole
from pa_console.tui.protocols import Clock, LiveStation, RuleScorer, ShownRules
from pa_console.tui.refresh import ALL_VIEWS, FRAME_S, views_of
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.screens.recording import RecordingScreen
from pa_console.tui.visible_lines import VisibleLines

LOOK_S = 1.0
"""How often the age of the telemetry is looked at, in wall seconds."""


class SessionApp(App[None]):
    """Feeds the main screen from a live station or, without one, from a recorded session."""

    class Received(Message):
        """The station yielded an event."""

        def __init__(self, event: Event) -> None:
            super().__init__()
            self.event = event

    class StreamEnded(Message):
        """The station yields no more; `problem` is empty when it ended in order."""

        def __init__(self, problem: str) -> None:
            super().__init__()
            self.problem = problem

    def __init__(
        self,
        world: World,
        station: LiveStation | None,
        rulebook: ShownRules,
        retriever: RuleScorer,
        *,
        readonly: bool = False,
        player: Player | None = None,
        clock: Clock = time.monotonic,
    ) -> None:
        """A live console needs `station`, a replay `player`; `clock` is replaced in tests."""
        super().__init__()
        self.error_console = PlainConsole(stderr=True)
        self._visible_lines = VisibleLines()
        self.world, self.station, self.player = world, station, player
        self.rulebook, self.retriever = rulebook, retriever
        self.readonly, self.clock = readonly, clock
        self.rate = station.rate if station else 1.0
        self.main: MainScreen | None = None
        self._folded = SessionState()
        self._dirty: frozenset[str] = frozenset()
        self._flush_due = False
        self._last_telemetry = clock()
        self._situation = ActionContext()
        self._waited = False

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Let every line of every widget, screen and picture go through the last gate."""
        return [*super().get_line_filters(), self._visible_lines]

    @property
    def state(self) -> SessionState:
        """The session as it stands, live or at the replay's position."""
        return self.player.state if self.player else self._folded

    @property
    def shown(self) -> MainScreen | None:
        """The main screen, or the recording that was opened over it."""
        screens = reversed(self.screen_stack)
        return next((screen for screen in screens if isinstance(screen, MainScreen)), None)

    @property
    def recording(self) -> RecordingScreen | None:
        """The recording that is looked at, if one is."""
        return self.shown if isinstance(self.shown, RecordingScreen) else None

    @property
    def shown_state(self) -> SessionState:
        """The session that is looked at: the recording's, else the session's own."""
        return self.recording.state if self.recording else self.state

    @property
    def situation(self) -> ActionContext:
        """What decides which actions are legal now; in a recording none that commands is."""
        recorded = self.player is not None or self.recording is not None
        return self._situation_of(self.shown_state, recorded)

    def _situation_of(self, state: SessionState, recorded: bool) -> ActionContext:
        current, alarms = state.current, state.alarms
        return ActionContext(
            replay=recorded,
            readonly=self.readonly or self.station is None,
            mission=state.active is not None,
            traced=current is not None,
            approval=current is not None and current.approval is not None,
            alarms=len(alarms),
            unseen=sum(not item.acknowledged for item in alarms),
            queue=len(state.queue),
            stopped=state.stop is not None,
        )

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Allow a registered action only while it is legal; it is hidden from the footer else.

        What is urgent concerns the session itself, whatever recording is looked at.
        """
        registered = find_action(action, parameters)
        if registered is not None:
            now = self.situation
            if registered.urgent:
                now = self._situation_of(self.state, self.player is not None)
            if registered.refusal(now) or (registered.opens_field and self._has_other_use):
                return False
        return super().check_action(action, parameters)

    @property
    def _has_other_use(self) -> bool:
        """Whether a key that opens a field is a letter here, or belongs to the screen on top."""
        return self.screen is not self.shown or isinstance(self.focused, Input | TextArea)

    def start_session(self) -> None:
        """Begin to listen; called after the first paint."""
        if self.station is not None and self.player is None:
            self.run_worker(self._listen(self.station), group="session", exit_on_error=False)
            self.set_interval(LOOK_S, self._look_for_silence)
        self.changed(ALL_VIEWS)

    async def _listen(self, station: LiveStation) -> None:
        """Post every event of the session; the screen stays usable when the stream breaks."""
        problem = ""
        try:
            async for event in station.run():
                self.post_message(self.Received(event))
                await asyncio.sleep(0)
        except Exception as error:  # whatever broke, the operator must keep the console
            problem = f"{type(error).__name__}: {error}"
        self.post_message(self.StreamEnded(problem))

    def on_session_app_received(self, message: Received) -> None:
        """Fold one event, and note which panes it concerns."""
        self._folded.apply(message.event)
        if message.event.data.kind == "telemetry":
            self._last_telemetry = self.clock()
        self.changed(views_of(message.event.data.kind))

    def on_session_app_stream_ended(self, message: StreamEnded) -> None:
        """Say that nothing new will arrive when that was not asked for."""
        if message.problem:
            self.notify(
                f"The session broke off: {message.problem}. What was received stays "
                "readable; start the console again to go on.",
                title="No more events",
                severity="error",
                timeout=60,
                markup=False,
            )
        self.changed(ALL_VIEWS)

    def changed(self, views: frozenset[str]) -> None:
        """Have `views` repainted with the next frame."""
        self._dirty |= views
        if not self._flush_due:
            self._flush_due = True
            self.set_timer(FRAME_S, self.flush)

    def flush(self) -> None:
        """Begin the next frame; a console that is closing has no screen left to paint."""
        self._flush_due = False
        if self.is_running:
            self.show_changes()

    def show_changes(self) -> None:
        """Repaint what has changed since the last frame."""
        views, self._dirty = self._dirty, frozenset()
        if self.recording is not None:
            self.recording.repaint()
        if views and self.main is not None and self.main.is_mounted and self.player is None:
            silent = self.clock() - self._last_telemetry
            self.main.refresh_views(self.state, views, self.rate, silent)
        self._tell_what_waits()
        if self.situation != self._situation:
            self._situation = self.situation
            self.refresh_bindings()

    def _tell_what_waits(self) -> None:
        """Tell an operator who looks at another screen that a plan has begun to wait."""
        current = self.state.current
        waits = current is not None and current.approval is not None
        away = self.main is not None and self.screen is not self.main
        if waits and not self._waited and away and not (self.readonly or self.player):
            self.notify("A plan waits for your decision: Esc goes back to it", title="Approval")
        self._waited = waits

    def _look_for_silence(self) -> None:
        if self.clock() - self._last_telemetry > 4 * LOOK_S:
            self.changed(frozenset(("status",)))
