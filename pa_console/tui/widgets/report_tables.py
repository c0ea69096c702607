"""The tables of an evaluation's report, laid out anew whenever their pane gets another width."""

from collections.abc import Sequence

from textual import events
from textual.app import ComposeResult
from textual.containers import ScrollableContainer
from textual.content import Content
from textual.widgets import Static

from pa_console.evaluation.reporting.table import Table
from pa_console.tui.table_text import tables_text

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
