"""The runs of an evaluation, a row each, and the tables of its report."""

from collections.abc import Sequence
from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import ScrollableContainer
from textual.content import Content
from textual.widgets import Static

from pa_console.evaluation.run_record import Opinion, RunRecord
from pa_console.evaluation.statistics import Table
from pa_console.tui.evaluation_view.tables import tables_text
from pa_console.tui.status_words import QUIET, WARN, term
from pa_console.tui.widgets.row_views import Cells, Layout, PointedRows

LEAST_WIDTH = 40


class ReportTables(ScrollableContainer):
    """A pane of tables, or of a text in their place; it scrolls both ways."""

    _tables: Sequence[Table] = ()

    def compose(self) -> ComposeResult:
        """Hold one text."""
        yield Static(id="evaluation-text", markup=False)

    def show(self, tables: Sequence[Table], instead: Content) -> None:
        """Show `tables`, or `instead` when there are none."""
        self._tables = tables
        if tables:
            self._write()
        else:
            self.query_one(Static).update(instead)

    def on_resize(self, _event: events.Resize) -> None:
        """Lay the tables out for the width that the pane has now."""
        if self._tables:
            self._write()

    def _write(self) -> None:
        width = self.scrollable_content_region.width
        if width:
            self.query_one(Static).update(tables_text(self._tables, max(LEAST_WIDTH, width - 2)))


_LEAST = Layout(
    "mission",
    (("mission", 8), ("model", 18), ("variant", 15), ("seed", 4), ("strict", 9), ("hybrid", 9),
     ("judge plan", 10), ("judge end", 10), ("status", 14), ("time", 8)),
    ("seed", "variant", "judge plan", "judge end", "time", "hybrid"),
)  # fmt: skip


def run_layout(width: int) -> Layout:
    """Return the columns that fit into `width` cells; the mission gets the room that is left."""
    columns = _LEAST.fitting(width - 1)
    room = max(0, width - sum(cells + 1 for _, cells in columns))
    first = ("mission", columns[0][1] + min(room, 20))
    return Layout("mission", (first, *columns[1:]), ())


def run_cells(record: RunRecord) -> Cells:
    """Return the cells of a run; a verdict that contradicts the true state carries ≠."""
    status = term("mission", record.status)
    return {
        "mission": (record.mission, "bold"),
        "model": (record.model, ""),
        "variant": (record.variant, QUIET if record.variant == "full" else ""),
        "seed": (f"{record.seed:>4}", QUIET),
        "strict": _score(record.strict),
        "hybrid": _score(record.hybrid),
        "judge plan": _verdict(record.judge_plan, record.strict),
        "judge end": _verdict(record.judge_outcome, record.strict),
        "status": (f"{status.glyph} {status.word}", status.style),
        "time": (f"{record.metrics.end_to_end_s:6.1f} s", QUIET),
    }


def _score(good: bool | None) -> tuple[str, str]:
    if good is None:
        return "–", QUIET
    mark = term("score", "success" if good else "failure")
    return f"{mark.glyph} {mark.word}", mark.style


def _verdict(given: Opinion | None, strict: bool) -> tuple[str, str]:
    if given is None:
        return "–", QUIET
    mark = term("verdict", given)
    wrong = (given == "Success") != strict
    return f"{mark.glyph} {mark.word}{'≠' * wrong}", WARN if wrong else mark.style


class RunRows(PointedRows):
    """The list of runs."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "choose", "Trace")]

    def __init__(self, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._records: dict[str, RunRecord] = {}

    @property
    def record(self) -> RunRecord | None:
        """The run at the pointer."""
        return self._records.get(self.cursor)

    def show(self, records: Sequence[RunRecord]) -> None:
        """Show these runs."""
        self._records = {record.run: record for record in records}
        self.set_keys(list(self._records))

    def layout_of(self, width: int) -> Layout:
        """Return the columns that fit."""
        return run_layout(width)

    def cells(self, key: str) -> Cells:
        """Return the cells of a run."""
        return run_cells(self._records[key])
