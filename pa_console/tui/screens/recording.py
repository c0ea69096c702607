"""A recorded session in the main screen: played, paused and stepped; nothing can be commanded."""

from collections.abc import Mapping

from textual.binding import Binding

from pa_console.schema.rule import Rule
from pa_console.schema.world import World
from pa_console.session.fold import SessionState
from pa_console.tui.history import History
from pa_console.tui.ports import Clock, PlayerPort
from pa_console.tui.refresh import ALL_VIEWS, FRAME_S
from pa_console.tui.replay import ReplayDeck
from pa_console.tui.screens.main import MainScreen

CLOSED = "REPLAY: this is a recording, every command is refused"


class RecordingScreen(MainScreen):
    """Drives its own player; over another screen, Escape and q go back there."""

    BINDINGS = [Binding("escape,q", "back", "Close")]

    def __init__(
        self,
        world: World,
        rules: Mapping[str, Rule],
        player: PlayerPort,
        clock: Clock,
        *,
        over: bool = False,
        view: str = "map",
    ) -> None:
        """`over` another screen one can go back; `view` is the pane that is shown at first."""
        super().__init__(world, rules, History(None), closed=CLOSED, mode="REPLAY", clock=clock)
        self.player, self.rules = player, rules
        self._deck = ReplayDeck(player, clock)
        self._over, self._view = over, view
        self._dirty: frozenset[str] = ALL_VIEWS

    @property
    def state(self) -> SessionState:
        """The session at the position of the player."""
        return self.player.state

    @property
    def rate(self) -> float:
        """Recorded seconds per wall second."""
        return self._deck.rate

    def on_mount(self) -> None:
        """Show where the recording stands, and let it play when it is told to."""
        self.set_interval(FRAME_S, self._tick)
        self.show_replay(self._deck.line())

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer to go back only where there is a screen to go back to."""
        return self._over if action == "back" else super().check_action(action, parameters)

    def action_back(self) -> None:
        """Go back to the screen from which the recording was opened."""
        self.dismiss()

    def _tick(self) -> None:
        if self._deck.play_on():
            self._moved()
        self.repaint()

    def _moved(self) -> None:
        self._dirty |= self._deck.views
        self.show_replay(self._deck.line())

    def repaint(self) -> None:
        """Repaint the panes that the last moves have changed."""
        views, self._dirty = self._dirty, frozenset()
        if views and self.is_mounted:
            self.refresh_views(self.state, views, self.rate, 0.0)
            self.app.refresh_bindings()

    def set_rate(self, rate: float) -> None:
        """Play at another speed."""
        self._deck.rate = rate
        self._moved()

    def play_pause(self) -> None:
        """Play or pause."""
        self._deck.play_pause()
        self._moved()

    def step(self, by: int) -> None:
        """One event forward or back."""
        self._deck.step(by)
        self._moved()

    def next_mission(self) -> None:
        """On to where the next mission begins."""
        self._deck.next_mission()
        self._moved()
