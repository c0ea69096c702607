"""The recorded sessions: open one, compare two, export one, run one again."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from threading import Event
from typing import TypeVar

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.screen import Screen
from textual.widgets import Static

from pa_console.schema.document import DocumentError
from pa_console.schema.text import count
from pa_console.session.log_index import Progress
from pa_console.session.past_sessions import SessionSummary, Soundness, past_sessions, soundness
from pa_console.tui.copied_file import export_folder, trace_text, write_copy
from pa_console.tui.protocols import Clock
from pa_console.tui.replay.recordings import (
    ComparedLog,
    KnownWorld,
    OpenedLog,
    open_compared,
    open_log,
)
from pa_console.tui.replay.run_again import run_again
from pa_console.tui.screens.compare import CompareScreen, Side
from pa_console.tui.screens.opening_log import OpeningLog, is_large
from pa_console.tui.screens.recording import RecordingScreen
from pa_console.tui.status_words import WARN
from pa_console.tui.trace.rows import row
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.row_views import TextRows
from pa_console.tui.widgets.session_rows import SessionRows, detail_rows

Log = TypeVar("Log", OpenedLog, ComparedLog)
MOST = 200
"""The number of sessions listed, the newest first."""


class SessionsScreen(Screen[None]):
    """Sessions above, the one at the pointer below; logs are checked beside the screen."""

    BINDINGS = [
        Binding("escape", "back", "Back"),
        Binding("c", "compare", "Compare"),
        Binding("x", "export", "Export"),
        Binding("r", "again", "Run again"),
        Binding("f5", "read", "Read anew", show=False),
    ]

    def __init__(self, folder: Path, clock: Clock, copies: Path | None = None) -> None:
        """Show the sessions whose logs are in `folder`; exports go to `copies`."""
        super().__init__()
        self._folder, self._clock = folder, clock
        self._copies = copies or export_folder()
        self._left = Event()
        self._read = False

    def compose(self) -> ComposeResult:
        """Yield the title, the list with its heading, and the detail."""
        yield Static(id="sessions-title", markup=False)
        with Vertical():
            yield Static(id="sessions-heading", markup=False)
            yield SessionRows(id="sessions-list")
            with VerticalScroll(id="sessions-detail"):
                yield TextRows(id="sessions-sheet")
        yield KeyFooter()

    @property
    def listing(self) -> SessionRows:
        """The list of sessions."""
        return self.query_one(SessionRows)

    def on_mount(self) -> None:
        """Read the sessions."""
        self.listing.focus()
        self._show([])
        self.action_read()

    def on_unmount(self) -> None:
        """Let the threads end at their next step."""
        self._left.set()

    def action_read(self) -> None:
        """Read the folder again."""
        self.run_worker(self._look, thread=True, exclusive=True, exit_on_error=False)

    def _look(self) -> None:
        found = past_sessions(self._folder, MOST)
        if self._left.is_set():
            return
        self.app.call_from_thread(self._listed, found)
        for summary in found:
            if self._left.is_set():
                return
            self.app.call_from_thread(self._checked, str(summary.log), soundness(summary.log))

    def _listed(self, found: Sequence[SessionSummary]) -> None:
        self._read = True
        self._show(found)

    def _checked(self, key: str, standing: Soundness) -> None:
        if self.is_attached:
            self.listing.stand(key, standing)
            if key == self.listing.cursor:
                self._detail()

    def _show(self, found: Sequence[SessionSummary]) -> None:
        self.listing.show(found)
        told = count(len(found), "recorded session") if self._read else "reading …"
        text = f" SESSIONS  {told} in {self._folder}"
        self.query_one("#sessions-title", Static).update(Content(text))
        self._detail()

    def _detail(self) -> None:
        self.query_one("#sessions-heading", Static).update(self.listing.heading())
        session = self.listing.session
        if session is not None:
            rows = detail_rows(session, self.listing.standing(self.listing.cursor))
        elif self._read:
            rows = (row("", ("No session was recorded here yet.", WARN)),)
        else:
            rows = ()
        self.query_one("#sessions-detail").border_title = "Session" if session else ""
        self.query_one("#sessions-sheet", TextRows).show(rows)

    def on_resize(self, _event: events.Resize) -> None:
        """Lay out for the new width."""
        self.call_after_refresh(self._detail)

    @on(SessionRows.Pointed)
    def _pointed(self, event: SessionRows.Pointed) -> None:
        event.stop()
        self._detail()
        self.query_one("#sessions-detail", VerticalScroll).scroll_home(animate=False)

    @on(SessionRows.Chosen)
    def _chosen(self, event: SessionRows.Chosen) -> None:
        event.stop()
        log = Path(event.key)
        self._with_log(log, _open(log), self._play)

    def action_back(self) -> None:
        """Give up a comparison that was begun, else go back to the console."""
        if self.listing.marked:
            self.listing.mark("")
        else:
            self.dismiss()

    # What is done with a session

    def _with_log(
        self,
        log: Path,
        opening: Callable[[Progress | None], Log],
        then: Callable[[Log], None],
    ) -> None:
        """Open `log`, a large one beside the screen, and go on with it; what is wrong is told."""
        try:
            if is_large(log):

                def opened(found: Log | None) -> None:
                    if found is not None:
                        then(found)

                self.app.push_screen(OpeningLog[Log](log, opening), opened)
            else:
                then(opening(None))
        except (ValueError, OSError, DocumentError) as error:
            self.notify(str(error), title="Not opened", severity="error", timeout=10, markup=False)

    def _play(self, opened: OpenedLog) -> None:
        if opened.note:
            self.notify(opened.note, title="Session", severity="warning", markup=False)
        screen = RecordingScreen(opened.world, opened.rules, opened.player, self._clock, over=True)
        self.app.push_screen(screen)

    def action_compare(self) -> None:
        """Choose the first session of a comparison, then the second one."""
        listing = self.listing
        if listing.session is None:
            return
        if not listing.marked:
            listing.mark(listing.cursor)
            said = "Point at the other session and press c again; Esc gives it up"
            self.notify(said, title="Compare", markup=False)
        elif listing.marked == listing.cursor:
            self.notify("this is the same session: point at another one", title="Compare",
                        severity="warning", markup=False)  # fmt: skip
        else:
            first, second = Path(listing.marked), Path(listing.cursor)
            listing.mark("")
            self._with_log(first, _open(first), partial(self._compare, first, second))

    def _compare(self, first: Path, second: Path, opened: OpenedLog) -> None:
        recording = opened.player.recording
        known = KnownWorld.of(opened.world, recording)
        one = Side(first.name, recording, opened.world, opened.rules, opened.note)

        def both(other: ComparedLog) -> None:
            sides = (one, Side.of(second.name, other))
            self.app.push_screen(CompareScreen(*sides, self._clock))

        def opening(progress: Progress | None = None) -> ComparedLog:
            return open_compared(second, known, progress)

        self._with_log(second, opening, both)

    def action_export(self) -> None:
        """Write the traces of all missions of the session to a file."""
        session = self.listing.session
        if session is not None:
            self._with_log(session.log, _open(session.log), partial(self._export, session))

    def _export(self, session: SessionSummary, opened: OpenedLog) -> None:
        opened.player.seek(opened.player.duration)
        traces = opened.player.state.missions.values()
        if not traces:
            self.notify("it has no mission", title="Nothing exported", markup=False)
            return
        text = "\n\n".join(trace_text(trace, opened.rules) for trace in traces)
        where = write_copy(self._copies, f"{session.log.stem}-session.txt", text)
        also = "pa-console export writes Markdown, MCAP and pictures"
        self.notify(f"{where}; {also}", title="Exported", timeout=10, markup=False)

    def action_again(self) -> None:
        """Run the session again beside the screen, and report whether it came out equal."""
        session = self.listing.session
        if session is not None:
            self.notify("the session is being run again", title=session.title[:40], markup=False)
            self.run_worker(partial(self._again, session.log), thread=True, group="again",
                            exclusive=True, exit_on_error=False)  # fmt: skip

    def _again(self, log: Path) -> None:
        try:
            equal, told = run_again(log)
        except (ValueError, OSError, DocumentError) as error:
            equal, told = False, str(error)
        if not self._left.is_set():
            self.app.call_from_thread(self._told_again, equal, told)

    def _told_again(self, equal: bool, told: str) -> None:
        self.notify(told, title="Run again", severity="information" if equal else "error",
                    timeout=10, markup=False)  # fmt: skip


def _open(log: Path) -> Callable[[Progress | None], OpenedLog]:
    return lambda progress: open_log(log, None, progress)
