"""The evaluation screen: runs, failures, the tables of the report, and the trace of each run."""

import asyncio
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.content import Content
from textual.widgets import Input, Select, Static

from pa_console.evaluation.reporting.statistics import ReportTable
from pa_console.evaluation.run_record import RUNS, RunRecord, read_runs
from pa_console.session.recording import Player
from pa_console.tui.recordings import PlayableLog, log_of_run, open_log
from pa_console.tui.refresh import is_open
from pa_console.tui.rows import WrappedRow, layout, row
from pa_console.tui.screens.dialogs import AskFolder, open_beside
from pa_console.tui.screens.list_screen import ListScreen
from pa_console.tui.screens.recording import RecordingScreen
from pa_console.tui.status_words import WARN
from pa_console.tui.surroundings import SecondsClock
from pa_console.tui.widgets.evaluation_runs import (
    KINDS,
    LABELS,
    Kind,
    ReportTables,
    RunFilter,
    RunRows,
    nothing_rows,
    run_rows,
    title_text,
    totals_text,
)
from pa_console.tui.widgets.fields import LineField

LOOK_S = 1.0
"""The interval between two checks of the folder for new runs, in wall seconds."""


class EvaluationScreen(ListScreen[RunRows]):
    """The runs of an evaluation, and below them the run at the pointer.

    The screen follows an evaluation that is still running.
    """

    BINDINGS = [
        Binding("escape", "back", "Back"),
        Binding("f", "next_kind", "Failures"),
        Binding("slash", "search", "Search"),
        Binding("t", "tables", "Tables"),
        Binding("o", "other", "Other folder", show=False),
    ]

    def __init__(
        self, folder: Path, clock: SecondsClock = time.monotonic, *, over: bool = True
    ) -> None:
        """Show the evaluation in `folder`; if it is `over` another screen, Escape goes back."""
        super().__init__(RunRows(id="list"))
        self._folder, self._clock, self._over = folder, clock, over
        self._records: list[RunRecord] = []
        self._filter = RunFilter()
        self._stamp: tuple[int, int] | None = (-1, -1)
        self._built: list[ReportTable] | None = None
        self._problem = ""

    def above_list(self) -> ComposeResult:
        """Yield the filters and the totals."""
        with Horizontal(id="evaluation-filters"):
            yield LineField(
                id="evaluation-search",
                placeholder="filter: mission, model, variant, category, command",
            )
            yield Select(
                [(LABELS[kind], kind) for kind in KINDS],
                value="all",
                allow_blank=False,
                compact=True,
                id="evaluation-kind",
            )
        yield Static(id="evaluation-totals", markup=False)

    def below_body(self) -> ComposeResult:
        """Yield the report's tables."""
        yield ReportTables(id="evaluation-tables")

    def on_mount(self) -> None:
        """Read the runs, and check for new runs from now on."""
        self.listing.focus()
        self.set_interval(LOOK_S, self.look)
        self._title()
        self.look()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer to go back only if there is a screen below."""
        return self._over if action == "back" else super().check_action(action, parameters)

    # Reading the runs

    def look(self) -> None:
        """Read the runs again if their file has changed."""
        stamp = _stamp(self._folder / RUNS)
        if stamp != self._stamp:
            self._stamp = stamp
            self.run_worker(self._read(self._folder), group="evaluation", exclusive=True)

    async def _read(self, folder: Path) -> None:
        self._problem = ""
        try:
            self._records = await asyncio.to_thread(read_runs, folder)
        except (ValueError, OSError) as error:
            self._problem = str(error)
        self._built = None
        if not is_open(self):
            return
        self._show()
        if self.has_class("-tables"):
            await self._show_tables()

    def _show(self) -> None:
        """Show the runs that pass the filter; the pointer stays on its run."""
        shown = self._filter.passed(self._records)
        self.listing.show_items({record.run: record for record in shown})
        self._title()
        totals = totals_text(shown, len(self._records), self._problem)
        self.query_one("#evaluation-totals", Static).update(totals)
        self.show_detail()

    def _title(self) -> None:
        tables = self.has_class("-tables")
        self.entitle(title_text(self._folder, tables=tables, width=self.size.width))

    def detail(self) -> tuple[str, Sequence[WrappedRow]]:
        """Return everything about the run at the pointer, or the reason why there is no run."""
        record = self.listing.item
        if record is not None:
            return "Run", run_rows(record)
        if self._records:
            return "", (row("", ("No runs match the filter; f and / change it.", WARN)),)
        return "", nothing_rows(self._folder, self._problem)

    async def _show_tables(self) -> None:
        """Build the report's tables of all runs, and show them."""
        from pa_console.evaluation.reporting.report import build_tables  # noqa: PLC0415 - loads numpy

        if self._built is None:
            self._built = await asyncio.to_thread(build_tables, self._records)
        nothing = Content("\n").join(layout(nothing_rows(self._folder, self._problem), 76))
        self.query_one(ReportTables).show(self._built, nothing)

    # Input of the operator

    @on(Input.Changed, "#evaluation-search")
    def _search(self, event: Input.Changed) -> None:
        event.stop()
        self._filter = self._filter._replace(text=event.value.strip())
        self._show()

    @on(Input.Submitted, "#evaluation-search")
    def _to_list(self, event: Input.Submitted) -> None:
        event.stop()
        self.listing.focus()

    @on(Select.Changed, "#evaluation-kind")
    def _kind(self, event: Select.Changed) -> None:
        event.stop()
        kind = next(kind for kind in KINDS if kind == event.value)
        self._filter = self._filter._replace(kind=kind)
        self._show()

    @on(RunRows.RowChosen)
    def _chosen(self, event: RunRows.RowChosen) -> None:
        event.stop()
        self.action_trace()

    def on_resize(self, _event: events.Resize) -> None:
        """Fit the title to the new width."""
        self._title()

    def action_back(self) -> None:
        """Leave a field, or else go back to the console."""
        if isinstance(self.focused, Input):
            self.listing.focus()
        else:
            self.dismiss()

    def action_search(self) -> None:
        """Focus the search field."""
        self._turn(tables=False)
        self.query_one("#evaluation-search").focus()

    def action_next_kind(self) -> None:
        """Show the next kind of runs: each kind of failure in turn, then all runs again."""
        self._turn(tables=False)
        following: Kind = KINDS[(KINDS.index(self._filter.kind) + 1) % len(KINDS)]
        self.query_one("#evaluation-kind", Select).value = following

    def action_tables(self) -> None:
        """Show the report's tables, or the runs again."""
        self._turn(tables=not self.has_class("-tables"))

    def _turn(self, *, tables: bool) -> None:
        if tables == self.has_class("-tables"):
            return
        self.set_class(tables, "-tables")
        self._title()
        if tables:
            self.query_one("#evaluation-tables").focus()
            self.run_worker(self._show_tables(), group="evaluation-tables", exclusive=True)
        else:
            self.listing.focus()

    def action_other(self) -> None:
        """Ask for another folder and show it."""

        def given(folder: Path | None) -> None:
            if folder is not None:
                self._folder, self._stamp, self._records = folder, (-1, -1), []
                self._built = None
                self._show()
                self.look()

        self.app.push_screen(AskFolder("Folder of an evaluation, with a runs.jsonl:"), given)

    def action_trace(self) -> None:
        """Open the log of the run at the pointer, at its end, with the trace in view."""
        record = self.listing.item
        if record is None:
            return
        folder, mission = self._folder, record.mission

        def show(opened: PlayableLog) -> None:
            if opened.note:
                self.notify(opened.note, title=mission, severity="warning", markup=False)
            player = Player(opened.recording)
            player.seek(player.duration)
            screen = RecordingScreen(
                opened.world, opened.rules, player, self._clock, over=True, view="trace"
            )
            self.app.push_screen(screen)

        try:
            log = log_of_run(record.log, folder)
        except ValueError as error:
            self.notify(str(error), title="No trace", severity="error", timeout=10, markup=False)
        else:
            open_beside(self, log, partial(open_log, log, folder), show, "No trace")


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return the size and the time of the last change; None if there is no such file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns
