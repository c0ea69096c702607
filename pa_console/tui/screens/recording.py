"""A recorded session in the main screen: played, stepped and searched; it takes no command."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, cast

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.content import Content
from textual.widgets import Static

from pa_console.schema.rule import Rule
from pa_console.schema.text import clock_text
from pa_console.schema.world import World
from pa_console.session.log.chain import LogError
from pa_console.session.recording import Player
from pa_console.session.state import SessionState
from pa_console.session.timeline import MARK_KINDS, MarkKind
from pa_console.tui.actions import ActionContext, refused_command
from pa_console.tui.kept_input import History
from pa_console.tui.refresh import ALL_VIEWS, FRAME_S, is_open, views_of
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.status_words import QUIET, term
from pa_console.tui.surroundings import SecondsClock
from pa_console.tui.widgets.bars import Scrubber

if TYPE_CHECKING:
    from pa_console.tui.app import ConsoleApp

MISSIONS = frozenset[MarkKind](("mission",))
FINDINGS = frozenset(MARK_KINDS) - MISSIONS
WIDE = 120
"""Cells from which on the line has room for the signs of the marks."""


CLOSED = "REPLAY: this is a recording, every command is refused"


class RecordingScreen(MainScreen):
    """Drives its own player; over another screen, Escape and q go back there."""

    BINDINGS = [Binding("escape,q", "back", "Close")]

    def __init__(
        self,
        world: World,
        rules: Mapping[str, Rule],
        player: Player,
        clock: SecondsClock,
        *,
        over: bool = False,
        view: str = "map",
    ) -> None:
        """`over` another screen one can go back; `view` is the pane that is shown at first."""
        super().__init__(world, rules, History(None), closed=CLOSED, mode="REPLAY", clock=clock)
        self.world, self.player = world, player
        self._seen_at = clock()
        self._over, self._view = over, view
        self._dirty: frozenset[str] = ALL_VIEWS
        self._situation: ActionContext | None = None

    @property
    def state(self) -> SessionState:
        """The session at the position of the player."""
        return self.player.state

    def replay_line(self) -> ComposeResult:
        """Yield the banner and the bar."""
        yield Static(id="replay", markup=False)
        yield Scrubber(self.player.recording.timeline, id="scrubber")

    def on_mount(self) -> None:
        """Show the position of the recording, and let it play when requested."""
        self.set_interval(FRAME_S, self._tick)
        self._moved()

    def on_resize(self, event: events.Resize) -> None:  # noqa: ARG002 - the size is the screen's
        """Fit the banner to the terminal's size, once the layout has been chosen for it."""
        self.call_after_refresh(self._moved)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer to go back only where there is a screen to go back to."""
        return self._over if action == "back" else super().check_action(action, parameters)

    def action_back(self) -> None:
        """Go back to the screen from which the recording was opened."""
        self.dismiss()

    def on_key(self, event: events.Key) -> None:
        """Report that a key would have given a command in a live session."""
        command = refused_command(event.key, cast("ConsoleApp", self.app).keys)
        if command:
            event.stop()
            self.notify(
                "this is a recording; nothing can be commanded in it",
                title=f"REPLAY: {command} refused",
                severity="warning",
                markup=False,
            )

    def on_scrubber_place_clicked(self, message: Scrubber.PlaceClicked) -> None:
        """Go to the place that was clicked."""
        message.stop()
        self.move(lambda player: player.seek(message.share * player.duration))

    def _tick(self) -> None:
        """Let the wall time since the last frame pass."""
        if not is_open(self):
            return
        now, was_playing = self._clock(), self.player.playing
        past, self._seen_at = now - self._seen_at, now
        try:
            kinds = self.player.advance(past)
        except LogError as error:
            self._cannot_read(error)
        else:
            self._dirty |= {view for kind in kinds for view in views_of(kind)}
            if was_playing:
                self._moved()
        self.repaint()

    def _moved(self) -> None:
        self.query_one("#replay", Static).update(banner(self.player, self.size.width), layout=False)
        self.query_one(Scrubber).show(self.player.position)

    def repaint(self) -> None:
        """Repaint the panes that the last moves have changed."""
        views, self._dirty = self._dirty, frozenset()
        if views and self.is_mounted and is_open(self):
            self.refresh_views(self.state, views, self.player.rate, 0.0)
            situation = cast("ConsoleApp", self.app).situation
            if situation != self._situation:
                self._situation = situation
                self.app.refresh_bindings()

    def move(self, how: Callable[[Player], object]) -> None:
        """Move the recording; a log that cannot be read any more is told."""
        try:
            how(self.player)
        except LogError as error:
            self._cannot_read(error)
        else:
            self._dirty = ALL_VIEWS
            self._moved()

    def _cannot_read(self, error: LogError) -> None:
        self._dirty = ALL_VIEWS
        self._moved()
        self.notify(str(error), title="Replay", severity="error", timeout=30, markup=False)

    def play_pause(self) -> None:
        """Play from now on, or pause."""
        self._seen_at = self._clock()
        self.move(Player.pause if self.player.playing else Player.play)

    def jump(self, kinds: frozenset[MarkKind], by: int, what: str) -> None:
        """Go to the next mark of these `kinds`, or the one before; say when there is none."""

        def how(player: Player) -> None:
            if not (player.next_mark(kinds) if by > 0 else player.mark_back(kinds)):
                where = "after" if by > 0 else "before"
                self.notify(f"no {what} {where} this moment", title="Replay", markup=False)

        self.move(how)


def banner(player: Player, width: int) -> Content:
    """Return the line that marks a replay, with its position and the keys that move it."""
    sign = "▶ playing" if player.playing else "■ ended" if player.finished else "‖ paused"
    where = f"log {clock_text(player.position)} of {clock_text(player.duration)}"
    parts: list[tuple[str, str] | str] = [
        (" REPLAY ", "bold reverse $text-warning"),
        (f" {sign} ×{player.rate:g} ", "bold"),
        f" {where}  event {player.index} of {len(player.recording)}  ",
    ]
    if width >= WIDE:
        for kind in reversed(MARK_KINDS):
            mark = term("mark", kind)
            parts += [(f"{mark.glyph} ", f"bold {mark.style}"), (f"{mark.word}  ", QUIET)]
    else:
        parts.append(("F1 all keys", QUIET))
    return Content.assemble(*parts)
