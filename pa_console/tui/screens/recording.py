"""The main screen of a recorded session, to play, step through and search; it takes no commands."""

import asyncio
import re
from collections.abc import Callable, Mapping
from datetime import timedelta
from pathlib import Path
from typing import cast

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from pa_console.schema.rule import Rule
from pa_console.schema.text import clock_text
from pa_console.schema.world import World
from pa_console.session.log.chain import LogError
from pa_console.session.recording import Player, Recording
from pa_console.session.state import SessionState
from pa_console.session.timeline import MARK_KINDS, MarkKind
from pa_console.tui.actions import ActionContext, ActionHost, refused_command
from pa_console.tui.kept_input import History
from pa_console.tui.refresh import ALL_VIEWS, FRAME_S, is_open, views_of
from pa_console.tui.rows import column
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.status_words import NOTE, QUIET, term
from pa_console.tui.surroundings import SecondsClock
from pa_console.tui.widgets.bars import Scrubber
from pa_console.tui.widgets.fields import LineField
from pa_console.tui.widgets.row_views import VirtualRows
from pa_console.views.event_words import Hit, kind_in_words, search

FINDING = "finding, override, alarm, refusal or fault"
MARKS: dict[str, frozenset[MarkKind]] = {
    "mission": frozenset(("mission",)),
    FINDING: frozenset(MARK_KINDS) - {"mission"},
}
"""The kinds of marks that can be jumped to, by name."""

CLOSED = "REPLAY: this is a recording, every command is refused"
HINT = "words in any order; Enter goes to the list, and there to the event; Esc goes back"
ACCEPTED = (
    "1:30 into the recording   s1:30 the session's own clock   @14:05:30 the time of day\n"
    "+30 -30 seconds from here   #120 event 120   50% of it   end"
)
"""The accepted forms, for the operator."""

MOST = 500
"""The maximum number of events that a search lists."""

STEP = 20_000
"""The number of events searched between two checks for newer input."""

WIDE = 120
"""The minimum width of a banner with the signs of the marks, in cells."""


class RecordingScreen(MainScreen):
    """A main screen with its own player; over another screen, Escape and q go back."""

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
        """Show the recording of `player`; if `over` another screen, it can be closed.

        `view` is the pane that is shown first.
        """
        super().__init__(world, rules, History(None), closed=CLOSED, mode="REPLAY", clock=clock)
        self.world, self.player = world, player
        self.log_file = player.recording.path
        self._seen_at = clock()
        self._over, self._view = over, view
        self._dirty: frozenset[str] = ALL_VIEWS
        self._situation: ActionContext | None = None

    @property
    def state(self) -> SessionState:
        """The state of the session at the position of the player."""
        return self.player.state

    def replay_line(self) -> ComposeResult:
        """Yield the banner and the bar."""
        yield Static(id="replay", markup=False)
        yield Scrubber(self.player.recording.timeline, id="scrubber")

    def on_mount(self) -> None:
        """Show the position of the recording, and advance it while the recording plays."""
        self.set_interval(FRAME_S, self._tick)
        self._moved()

    def on_resize(self, event: events.Resize) -> None:  # noqa: ARG002 - the size is the screen's
        """Fit the banner to the terminal's size, after the layout is chosen."""
        self.call_after_refresh(self._moved)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer to go back only if there is a screen below."""
        return self._over if action == "back" else super().check_action(action, parameters)

    def action_back(self) -> None:
        """Go back to the screen from which the recording was opened."""
        self.dismiss()

    def on_key(self, event: events.Key) -> None:
        """Show a notice if the key would give a command in a live session."""
        command = refused_command(event.key, cast(ActionHost, self.app).keys)
        if command:
            event.stop()
            self.notify(
                "this is a recording; it takes no commands",
                title=f"REPLAY: {command} refused",
                severity="warning",
                markup=False,
            )

    def on_scrubber_place_clicked(self, message: Scrubber.PlaceClicked) -> None:
        """Go to the clicked place."""
        message.stop()
        self.move(lambda player: player.seek(message.share * player.duration))

    def _tick(self) -> None:
        """Advance the player by the wall time since the last frame."""
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
        """Repaint the panes that the latest moves have changed."""
        views, self._dirty = self._dirty, frozenset()
        if views and self.is_mounted and is_open(self):
            self.refresh_views(self.state, views, self.player.rate, 0.0)
            situation = cast(ActionHost, self.app).situation
            if situation != self._situation:
                self._situation = situation
                self.app.refresh_bindings()

    def move(self, how: Callable[[Player], object]) -> None:
        """Move the recording; show an error if the log can no longer be read."""
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
        """Play from the current position, or pause."""
        self._seen_at = self._clock()
        self.move(Player.pause if self.player.playing else Player.play)

    def jump(self, mark: str, by: int) -> None:
        """Go to the next or previous mark of a kind in MARKS; show a notice if there is none."""

        def how(player: Player) -> None:
            if not (player.next_mark(MARKS[mark]) if by > 0 else player.mark_back(MARKS[mark])):
                where = "after" if by > 0 else "before"
                self.notify(f"no {mark} {where} this moment", title="Replay", markup=False)

        self.move(how)

    def to_moment(self) -> None:
        """Ask for a time or an event and go there."""
        from pa_console.tui.screens.dialogs import AskLine  # noqa: PLC0415 - not at the start

        def given(index: int | None) -> None:
            if index is not None:
                self.move(lambda player: player.to_event(index - 1))

        asking = AskLine("Where to?", ACCEPTED, lambda text: read_position(text, self.player))
        self.app.push_screen(asking, given)

    def search(self) -> None:
        """Search the recording and jump to the choice."""

        def chosen(index: int | None) -> None:
            if index is not None:
                self.move(lambda player: player.to_event(index))

        self.app.push_screen(FindEvent(self.player.recording, self.player.index), chosen)

    def compare(self) -> None:
        """Ask for another recording and show where it differs from this one."""
        from pa_console.tui.recordings import PlayableLog  # noqa: PLC0415 - not at the start
        from pa_console.tui.screens.compare import open_comparison  # noqa: PLC0415
        from pa_console.tui.screens.dialogs import AskLine  # noqa: PLC0415

        own = PlayableLog("this one", self.player.recording, self.world, self.rules)

        def read(text: str) -> Path:
            path = Path(text).expanduser()
            if not path.is_file():
                raise ValueError(f"{path}: there is no such log")
            return path

        def given(other: Path | None) -> None:
            if other is not None:
                open_comparison(self, own, other, self._clock)

        question = "Which session log is to be compared with this one?"
        self.app.push_screen(AskLine(question, "Enter compares, Esc goes back", read), given)


def read_position(text: str, player: Player) -> int:
    """Return the number of events up to the moment that `text` names.

    Raises ValueError, with the valid forms, if `text` has none of them.
    """
    timeline, text = player.recording.timeline, "".join(text.split()).lower()
    if text == "end":
        return len(timeline)
    if match := re.fullmatch(r"#(\d{1,12})", text):
        return min(int(match[1]), len(timeline))
    if (match := re.fullmatch(r"(\d{1,3}(?:\.\d+)?)%", text)) and float(match[1]) <= 100:
        return timeline.count_until(timeline.duration * float(match[1]) / 100)
    match = re.fullmatch(r"([-+s@]?)((?:\d{1,6}:){0,2}\d{1,6}(?:\.\d+)?)", text)
    if match is None:
        raise ValueError(f"“{text}” is not a time or an event; write one like these:\n{ACCEPTED}")
    sign, seconds = match[1], _seconds(match[2])
    if sign == "s":
        if not timeline.ticks_per_s:
            raise ValueError("this recording has no telemetry, and so no session clock")
        return timeline.count_until_tick(seconds * timeline.ticks_per_s)
    if sign == "@":
        return timeline.count_until(_since_start(seconds, player))
    if sign:
        return timeline.count_until(player.position + (seconds if sign == "+" else -seconds))
    return timeline.count_until(seconds)


def _seconds(text: str) -> float:
    total = 0.0
    for part in text.split(":"):
        total = 60 * total + float(part)
    return total


def _since_start(time_of_day: float, player: Player) -> float:
    """Return the seconds from the first event to the next occurrence of a time of day (UTC)."""
    start = player.recording.timeline.start
    if start is None:
        return 0.0
    midnight = start.replace(hour=0, minute=0, second=0, microsecond=0)
    passed = (midnight + timedelta(seconds=time_of_day) - start).total_seconds()
    return passed if passed >= 0 else passed + timedelta(days=1).total_seconds()


def banner(player: Player, width: int) -> Content:
    """Return the line that marks a replay: its state, its position, and the signs of the marks."""
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


class HitRows(VirtualRows):
    """A row for each event that was found, with its time, mission and text."""

    def __init__(self, recording: Recording, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._recording = recording
        self._hits: dict[str, Hit] = {}

    def show(self, hits: list[Hit]) -> None:
        """Show these hits."""
        self._hits = {str(hit.index): hit for hit in hits}
        self.set_keys(list(self._hits))

    def row(self, index: int, width: int) -> Content:
        """Return the row of one hit."""
        del width
        hit = self._hits[self.keys[index]]
        return Content.assemble(
            column(clock_text(self._recording.timeline.seconds[hit.index]), 7, QUIET),
            column(hit.mission, 9, "bold"),
            (f"{kind_in_words(hit.kind)}  ", NOTE),
            hit.excerpt,
        )


class FindEvent(ModalScreen[int | None]):
    """A search that returns the chosen event, or None; the pointer starts at the next hit."""

    BINDINGS = [Binding("escape", "dismiss", "Back")]

    def __init__(self, recording: Recording, here: int) -> None:
        """Search `recording`; `here` is the number of events played."""
        super().__init__()
        self._recording, self._here = recording, here

    def compose(self) -> ComposeResult:
        """Yield the field, the list and the number of matches."""
        with Vertical(id="find"):
            yield LineField(id="find-words", placeholder="words of an event")
            yield HitRows(self._recording, id="find-list")
            yield Static(HINT, id="find-note", markup=False)

    def on_mount(self) -> None:
        """Focus the field."""
        self.query_one("#find").border_title = "Search"
        self.query_one(Input).focus()

    @on(Input.Changed)
    def _typed(self, event: Input.Changed) -> None:
        event.stop()
        self.run_worker(self._search(event.value), group="find", exclusive=True)

    @on(Input.Submitted)
    def _to_list(self, event: Input.Submitted) -> None:
        event.stop()
        if self.query_one(HitRows).keys:
            self.query_one(HitRows).focus()

    @on(VirtualRows.RowChosen)
    def _chosen(self, event: VirtualRows.RowChosen) -> None:
        event.stop()
        self.dismiss(int(event.key))

    async def _search(self, text: str) -> None:
        """Show the events with all the words of `text`, searching one part of the log at a time."""
        hits: list[Hit] = []
        end = len(self._recording)
        try:
            for first in range(0, end, STEP):
                last = min(first + STEP, end)
                matches = search(self._recording, text, first, last)
                hits += await asyncio.to_thread(list, matches)
                if len(hits) >= MOST:
                    break
                if end > STEP:
                    self._note(f"{len(hits)} found in {last / end:.0%} of the recording")
        except LogError as error:
            self._note(str(error))
            return
        self._show(text, hits[:MOST])

    def _show(self, text: str, hits: list[Hit]) -> None:
        rows = self.query_one(HitRows)
        rows.show(hits)
        following = next((str(hit.index) for hit in hits if hit.index >= self._here), "")
        rows.point_at(following)
        first = f"the first {MOST}" if len(hits) == MOST else str(len(hits))
        self._note(f"{first} found; Enter goes to the list" if text.strip() else HINT)

    def _note(self, text: str) -> None:
        self.query_one("#find-note", Static).update(text)
