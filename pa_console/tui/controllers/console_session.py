"""The session that the console shows, the screens over it, and the actions that are legal now."""

from collections.abc import Callable
from typing import Any

from textual.app import App
from textual.screen import Screen
from textual.widgets import Input, TextArea

from pa_console.schema.world import World
from pa_console.session.recording import Player
from pa_console.session.state import SessionState
from pa_console.station.earlier.last_session import LastSession
from pa_console.tui.actions import ActionContext, ConsoleAction
from pa_console.tui.kept_input import History
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.screens.recording import RecordingScreen
from pa_console.tui.surroundings import JoinedTo, LiveStation, SecondsClock


class ConsoleSession:
    """The session for all controllers: the station or the player, and the screens of the `app`."""

    def __init__(
        self,
        app: App[None],
        world: World,
        station: "LiveStation | None",
        player: Player | None,
        *,
        readonly: bool,
        clock: SecondsClock,
        joined: JoinedTo | None = None,
        last: LastSession | None = None,
    ) -> None:
        """Build the session of a live console with `station`, or of a replay with `player`.

        `joined` is the session of another station. Standing orders of the `last` session can be
        taken up again.
        """
        self.last = last
        self.app, self.world = app, world
        self.station, self.player = station, player
        self.readonly, self.clock, self.joined = readonly or joined is not None, clock, joined
        self.rate = station.rate if station else 1.0
        self.main: MainScreen | None = None
        self.typed = History()
        """The texts typed into the mission field, in this and in earlier sessions."""

        self.folded = SessionState()
        """The state folded from the station's events; a player has its own state."""

    @property
    def state(self) -> SessionState:
        """The state of the session, live or at the replay's position."""
        return self.player.state if self.player else self.folded

    @property
    def shown(self) -> MainScreen | None:
        """The main screen, or a recording that was opened over it."""
        screens = reversed(self.app.screen_stack)
        return next((screen for screen in screens if isinstance(screen, MainScreen)), None)

    @property
    def recording(self) -> RecordingScreen | None:
        """The shown recording; None if there is none."""
        return self.shown if isinstance(self.shown, RecordingScreen) else None

    @property
    def shown_state(self) -> SessionState:
        """The state of the shown recording, or else of the session."""
        return self.recording.state if self.recording else self.state

    @property
    def decides(self) -> bool:
        """True if decisions are possible here; in a joined session, these are signatures."""
        return bool(self.joined.signer) if self.joined is not None else not self.readonly

    @property
    def asks(self) -> bool:
        """True if questions are answered here, as they are in a joined session too."""
        return self.station is not None and (self.joined is not None or not self.readonly)

    def is_open(self, kind: type[Screen[Any]]) -> bool:
        """Return whether a screen of this kind is open, on top or below another one."""
        return any(isinstance(screen, kind) for screen in self.app.screen_stack)

    def tell(self, text: str, title: str, bad: bool = False) -> None:
        """Show a notice; its text is not parsed as markup."""
        severity = "error" if bad else "information"
        self.app.notify(text, title=title, severity=severity, markup=False)

    def confirm(self, question: str, do: Callable[[], object], *, yes: str, no: str) -> None:
        """Ask the operator on any screen; call `do` if the answer is yes."""
        from pa_console.tui.screens.dialogs import Confirm  # noqa: PLC0415 - not at the start

        def answered(agreed: bool | None) -> None:
            if agreed:
                do()

        self.app.push_screen(Confirm(question, yes=yes, no=no), answered)

    # Legal actions

    @property
    def situation(self) -> ActionContext:
        """The state that decides which actions are legal now; a recording allows no commands."""
        recorded = self.player is not None or self.recording is not None
        return self._situation_of(self.shown_state, recorded)

    def _situation_of(self, state: SessionState, recorded: bool) -> ActionContext:
        current, alarms = state.current, state.alarms
        return ActionContext(
            replay=recorded,
            readonly=self.readonly or self.station is None,
            decides=self.decides and self.station is not None,
            stops=(self.joined is not None or not self.readonly) and self.station is not None,
            asks=self.asks,
            commander=self.joined is not None and self.joined.command_question is not None,
            mission=state.active is not None,
            traced=current is not None,
            approval=current is not None and current.approval is not None,
            alarms=len(alarms),
            unseen=sum(not item.acknowledged for item in alarms),
            queue=len(state.queue),
            agents=bool(state.last_agent),
            stopped=state.stop is not None,
            left=self.last is not None and bool(self.last.orders),
        )

    def allows(self, action: ConsoleAction) -> bool:
        """Return whether the action is legal now and its key has no other use.

        An urgent action concerns the session itself, even if a recording is shown.
        """
        now = self.situation
        if action.urgent:
            now = self._situation_of(self.state, self.player is not None)
        return not action.refusal(now) and not (action.opens_field and self._has_other_use)

    @property
    def _has_other_use(self) -> bool:
        """True if a key that opens a field types a letter here or belongs to the top screen."""
        other_screen = self.app.screen is not self.shown
        return other_screen or isinstance(self.app.focused, Input | TextArea)
