"""Drives a recorded session in wall time and reports its position."""

from textual.content import Content

from pa_console.schema.text import clock_text
from pa_console.session.recording import RATES, Player
from pa_console.session.timeline import MARK_KINDS, MarkKind
from pa_console.tui.protocols import Clock
from pa_console.tui.refresh import ALL_VIEWS, views_of
from pa_console.tui.status_words import QUIET, term

MISSIONS = frozenset[MarkKind](("mission",))
FINDINGS = frozenset(MARK_KINDS) - MISSIONS
WIDE = 120
"""Cells from which on the line has room for the signs of the marks."""


class ReplayDeck:
    """Play, pause, step and jump; `views` are the panes that the last move has changed."""

    def __init__(self, player: Player, clock: Clock) -> None:
        self.player, self._clock = player, clock
        self._seen_at = clock()
        self.views = ALL_VIEWS

    @property
    def rate(self) -> float:
        """Recorded seconds per wall second."""
        return self.player.rate

    @rate.setter
    def rate(self, rate: float) -> None:
        self.player.rate = rate

    def change_rate(self, factor: float) -> None:
        """Go faster or slower, within what a player can."""
        self.player.rate = min(max(self.player.rate * factor, RATES[0]), RATES[-1])

    def play_on(self) -> bool:
        """Let the wall time since the last call pass; returns whether anything has changed."""
        now = self._clock()
        past, self._seen_at = now - self._seen_at, now
        was_playing = self.player.playing
        kinds = self.player.advance(past)
        self.views = frozenset(view for kind in kinds for view in views_of(kind))
        return was_playing

    def play_pause(self) -> None:
        """Play, or pause."""
        self._seen_at = self._clock()
        if self.player.playing:
            self.player.pause()
        else:
            self.player.play()
        self.views = ALL_VIEWS

    def step(self, by: int) -> None:
        """One event forward or back."""
        self.views = ALL_VIEWS
        if by > 0:
            self.player.step()
        else:
            self.player.step_back()

    def step_second(self, by: int) -> None:
        """One simulated second forward or back."""
        self.views = ALL_VIEWS
        self.player.step_seconds(by)

    def jump(self, kinds: frozenset[MarkKind], by: int) -> bool:
        """Go to the next mark of these `kinds`, or the one before; returns whether there is one."""
        self.views = ALL_VIEWS
        return self.player.next_mark(kinds) if by > 0 else self.player.mark_back(kinds)

    def to_event(self, index: int) -> None:
        """Go to just after event `index`."""
        self.views = ALL_VIEWS
        self.player.to_event(index)

    def to_share(self, share: float) -> None:
        """Go to a part of the whole, 0 to 1."""
        self.views = ALL_VIEWS
        self.player.seek(share * self.player.duration)

    def line(self, width: int) -> Content:
        """Return the banner: that this is a replay, where it stands, and how to move it."""
        player = self.player
        sign = "▶ playing" if player.playing else "■ ended" if player.finished else "‖ paused"
        where = f"log {clock_text(player.position)} of {clock_text(player.duration)}"
        total = len(player.recording)
        parts: list[tuple[str, str] | str] = [
            (" REPLAY ", "bold reverse $text-warning"),
            (f" {sign} ×{player.rate:g} ", "bold"),
            f" {where}  event {player.index} of {total}  ",
        ]
        if width >= WIDE:
            for kind in reversed(MARK_KINDS):
                mark = term("mark", kind)
                parts += [(f"{mark.glyph} ", f"bold {mark.style}"), (f"{mark.word}  ", QUIET)]
        else:
            parts.append(("F1 all keys", QUIET))
        return Content.assemble(*parts)
