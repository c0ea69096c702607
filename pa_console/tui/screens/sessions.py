"""The screen of recorded sessions, to open, compare, export and run them again."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from threading import Event
from typing import ClassVar

from textual import on
from textual.binding import Binding, BindingType
from textual.content import Content

from pa_console.evaluation.twin import resimulate
from pa_console.schema.document import DocumentError
from pa_console.schema.text import clock_text, count
from pa_console.session.log.chain import read_log, session_start
from pa_console.session.past_sessions import SessionSummary, Soundness, past_sessions, soundness
from pa_console.session.recording import Player
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.station.assembly import SessionSites
from pa_console.tui.kept_input import export_folder, write_copy
from pa_console.tui.recordings import PlayableLog, open_log
from pa_console.tui.rows import WrappedRow, fact, row
from pa_console.tui.screens.compare import open_comparison
from pa_console.tui.screens.dialogs import open_beside
from pa_console.tui.screens.list_screen import ListScreen
from pa_console.tui.screens.recording import RecordingScreen
from pa_console.tui.status_words import QUIET, WARN, term
from pa_console.tui.surroundings import SecondsClock
from pa_console.tui.widgets.row_views import Cells, Layout, PointedRows
from pa_console.tui.widgets.trace_pane import trace_text
from pa_console.views.status_words import outcomes_in_words

PROBLEM = "Not opened"
MOST = 200
"""The maximum number of sessions that are listed, newest first."""


class SessionRows(PointedRows[SessionSummary]):
    """The list of sessions, newest first; the marked session is the first of a comparison."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "choose", "Open")]

    COLUMNS: ClassVar[Layout] = Layout(
        "begun",
        (("begun", 16), ("title", 20), ("scenario", 14), ("missions", 8), ("outcomes", 16),
         ("length", 7), ("log", 12)),
        ("scenario", "missions", "length", "begun"),
    )  # fmt: skip

    def __init__(self, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._standings: dict[str, Soundness] = {}
        self.marked = ""

    def standing(self, key: str) -> Soundness | None:
        """Return the state of the log `key`; None while it is being checked."""
        return self._standings.get(key)

    def stand(self, key: str, standing: Soundness) -> None:
        """Set the state of the log `key`."""
        self._standings[key] = standing
        self.set_keys(self.keys)

    def mark(self, key: str) -> None:
        """Mark only the session `key`; an empty key marks none."""
        self.marked = key
        self.set_keys(self.keys)

    def grown(self, room: int) -> Mapping[str, int]:
        """Give the remaining room to the title and the outcomes."""
        return {"title": room - room // 3, "outcomes": room // 3}

    def cells(self, key: str) -> Cells:
        """Return the cells of a session."""
        summary, standing = self.items[key], self._standings.get(key)
        mark = term("log", standing.standing) if standing is not None else None
        title = f"≠ {summary.title}" if key == self.marked else summary.title
        return {
            "begun": (summary.local_start[:16], QUIET),
            "title": (title, "bold"),
            "scenario": (summary.scenario or "–", QUIET),
            "missions": (f"{len(summary.missions)}", ""),
            "outcomes": (outcomes_in_words(summary.outcomes), ""),
            "length": (clock_text(summary.length_s), QUIET),
            "log": mark.part if mark else ("checking …", QUIET),
        }


def detail_rows(summary: SessionSummary, standing: Soundness | None) -> tuple[WrappedRow, ...]:
    """Return the facts that the list has no room for, with every mission and the log's state."""
    running = standing is not None and standing.standing == "running"
    never = "not yet" if running else "its log was never closed"
    ended = never if summary.ending == "open" else summary.reason
    rows = [
        fact("session", f"{summary.session}, {clock_text(summary.length_s)} long"),
        fact("world", f"{summary.world}, rules {summary.rules}, seed {summary.seed}"),
        fact("scenario", summary.scenario or "none"),
        fact("model", summary.model),
        fact("ended", ended),
    ]
    if standing is not None:
        mark = term("log", standing.standing)
        detail = f": {standing.detail}" if standing.detail else ""
        rows.append(fact("log", mark.content, detail))
    for mission in summary.missions:
        mark = term("mission", mission.status or "open")
        rows.append(fact("mission", (f"{mission.id} ", "bold"), mark.content,
                        f"  {mission.origin}{mission.said}"))  # fmt: skip
        if mission.reason:
            rows.append(row("            ", (mission.reason, QUIET)))
    rows.append(fact("file", str(summary.log)))
    return tuple(rows)


class SessionsScreen(ListScreen[SessionRows]):
    """The sessions, and below them the one at the pointer; logs are checked in a thread."""

    BINDINGS = [
        Binding("escape", "back", "Back"),
        Binding("c", "compare", "Compare"),
        Binding("x", "export", "Export"),
        Binding("r", "again", "Run again"),
        Binding("f5", "read", "Read again", show=False),
    ]

    def __init__(self, folder: Path, clock: SecondsClock, copies: Path | None = None) -> None:
        """Show the sessions whose logs are in `folder`; exports go to `copies`."""
        super().__init__(SessionRows(id="list"))
        self._folder, self._clock = folder, clock
        self._copies = copies or export_folder()
        self._left = Event()
        self._read = False

    def on_mount(self) -> None:
        """Begin to read the sessions."""
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
        summaries = past_sessions(self._folder, MOST)
        if self._left.is_set():
            return
        self.app.call_from_thread(self._listed, summaries)
        for summary in summaries:
            if self._left.is_set():
                return
            self.app.call_from_thread(self._checked, str(summary.log), soundness(summary.log))

    def _listed(self, summaries: Sequence[SessionSummary]) -> None:
        self._read = True
        self._show(summaries)

    def _checked(self, key: str, standing: Soundness) -> None:
        if self.is_attached:
            self.listing.stand(key, standing)
            if key == self.listing.cursor:
                self.show_detail()

    def _show(self, summaries: Sequence[SessionSummary]) -> None:
        self.listing.show_items({str(summary.log): summary for summary in summaries})
        number = count(len(summaries), "recorded session") if self._read else "reading …"
        self.entitle(Content(f" SESSIONS  {number} in {self._folder}"))
        self.show_detail()

    def detail(self) -> tuple[str, Sequence[WrappedRow]]:
        """Return everything about the session at the pointer, or a notice if there is none."""
        session = self.listing.item
        if session is not None:
            return "Session", detail_rows(session, self.listing.standing(self.listing.cursor))
        nothing = row("", ("No sessions have been recorded here yet.", WARN))
        return "", (nothing,) if self._read else ()

    @on(SessionRows.RowChosen)
    def _chosen(self, event: SessionRows.RowChosen) -> None:
        event.stop()
        self._with_log(Path(event.key), self._play)

    def action_back(self) -> None:
        """Cancel a comparison that was begun, or else go back to the console."""
        if self.listing.marked:
            self.listing.mark("")
        else:
            self.dismiss()

    # Actions on a session

    def _with_log(self, log: Path, then: Callable[[PlayableLog], None]) -> None:
        open_beside(self, log, partial(open_log, log, None), then, PROBLEM)

    def _play(self, opened: PlayableLog) -> None:
        if opened.note:
            self.notify(opened.note, title="Session", severity="warning", markup=False)
        player = Player(opened.recording)
        screen = RecordingScreen(opened.world, opened.rules, player, self._clock, over=True)
        self.app.push_screen(screen)

    def action_compare(self) -> None:
        """Mark the first session of a comparison, or compare it with the second one."""
        listing = self.listing
        if listing.item is None:
            return
        if not listing.marked:
            listing.mark(listing.cursor)
            hint = "Select the other session and press c again; Esc cancels"
            self.notify(hint, title="Compare", markup=False)
        elif listing.marked == listing.cursor:
            self.notify("this is the same session; select another one", title="Compare",
                        severity="warning", markup=False)  # fmt: skip
        else:
            first, second = Path(listing.marked), Path(listing.cursor)
            listing.mark("")
            self._with_log(first, partial(self._compare, second))

    def _compare(self, second: Path, first: PlayableLog) -> None:
        open_comparison(self, first, second, self._clock)

    def action_export(self) -> None:
        """Write the traces of all missions of the session to a file."""
        session = self.listing.item
        if session is not None:
            self._with_log(session.log, partial(self._export, session))

    def _export(self, session: SessionSummary, opened: PlayableLog) -> None:
        player = Player(opened.recording)
        player.seek(player.duration)
        traces = player.state.missions.values()
        if not traces:
            self.notify("the session has no mission", title="Nothing exported", markup=False)
            return
        text = "\n\n".join(trace_text(trace, opened.rules) for trace in traces)
        where = write_copy(self._copies, f"{session.log.stem}-session.txt", text)
        also = "pa-console export writes Markdown, MCAP and screenshots"
        self.notify(f"{where}; {also}", title="Exported", timeout=10, markup=False)

    def action_again(self) -> None:
        """Run the session again in a thread, and show whether the results are equal."""
        session = self.listing.item
        if session is not None:
            self.notify("the session is being run again", title=session.title[:40], markup=False)
            self.run_worker(partial(self._again, session.log), thread=True, group="again",
                            exclusive=True, exit_on_error=False)  # fmt: skip

    def _again(self, log: Path) -> None:
        try:
            equal, message = run_again(log)
        except (ValueError, OSError, DocumentError) as error:
            equal, message = False, str(error)
        if not self._left.is_set():
            self.app.call_from_thread(self._told_again, equal, message)

    def _told_again(self, equal: bool, message: str) -> None:
        self.notify(message, title="Run again", severity="information" if equal else "error",
                    timeout=10, markup=False)  # fmt: skip


def run_again(log: Path) -> tuple[bool, str]:
    """Run a session again; return whether telemetry and rehearsals are equal, and a message.

    The rules are not checked again; `pa-console replay LOG --resimulate` checks them too. Raises
    ValueError (DocumentError) if the log cannot be read, or if its world or scenario is missing.
    """
    started, sites = session_start(next(read_log(log), None), log), SessionSites()
    world, file = sites.world_of(started, log), sites.world_file(started, log)
    scenario = None
    if started.scenario and file is not None:
        loaded = open_scenario(world, file, started.scenario)
        if started.scenario_sha256 not in ("", loaded.sha256):
            raise ValueError(f"its scenario “{started.scenario}” has changed since")
        scenario = loaded.scenario
    twin = resimulate(read_log(log), world, scenario)
    if twin.equal:
        compared = f"{count(twin.pictures, 'picture')} and {count(twin.rehearsals, 'rehearsal')}"
        return True, f"{compared} of plans are equal"
    return False, f"the results differ, first at {twin.first_difference or 'no picture'}"
