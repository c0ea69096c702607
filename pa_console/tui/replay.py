"""Drives a recorded session in wall time and says where it stands."""

from textual.content import Content

from pa_console.tui.ports import Clock, PlayerPort
from pa_console.tui.refresh import ALL_VIEWS, views_of
from pa_console.tui.vocabulary import QUIET
from pa_console.tui.words import clock_text


class ReplayDeck:
    """Play, pause and step; `views` are the panes that the last move has changed."""

    def __init__(self, player: PlayerPort, clock: Clock) -> None:
        self._player, self._clock = player, clock
        self._seen_at = clock()
        self.views = ALL_VIEWS

    @property
    def rate(self) -> float:
        """Recorded seconds per wall second."""
        return self._player.rate

    @rate.setter
    def rate(self, rate: float) -> None:
        self._player.rate = rate

    def play_on(self) -> bool:
        """Let the wall time since the last call pass; returns whether anything has changed."""
        now = self._clock()
        past, self._seen_at = now - self._seen_at, now
        was_playing = self._player.playing
        events = self._player.advance(past)
        self.views = frozenset(view for e in events for view in views_of(e.data.kind))
        return was_playing

    def play_pause(self) -> None:
        """Play, or pause."""
        self._seen_at = self._clock()
        if self._player.playing:
            self._player.pause()
        else:
            self._player.play()
        self.views = ALL_VIEWS

    def step(self, by: int) -> None:
        """One event forward or back."""
        if by > 0:
            self._player.step()
        else:
            self._player.step_back()
        self.views = ALL_VIEWS

    def next_mission(self) -> None:
        """Go on until another mission has arrived, or to the end."""
        known = len(self._player.state.missions)
        while not self._player.finished and len(self._player.state.missions) <= known:
            self._player.step_mission()
        self.views = ALL_VIEWS

    def line(self) -> Content:
        """Return the banner: that this is a replay, where it stands, and its keys."""
        player = self._player
        sign = "▶ playing" if player.playing else "■ ended" if player.finished else "‖ paused"
        where = f"{clock_text(player.position)} of {clock_text(player.duration)}"
        return Content.assemble(
            (" REPLAY ", "bold reverse $text-warning"),
            f" {sign} ×{player.rate:g}  {where}  event {player.index}  ",
            ("space play/pause  ← → step  + - speed  n next mission", QUIET),
        )
