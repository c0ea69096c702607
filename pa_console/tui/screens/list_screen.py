"""A screen with a list, and below it the detail of the item at the pointer."""

from collections.abc import Sequence
from typing import Any, Generic, TypeVar

from textual import events, on
from textual.app import ComposeResult
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.screen import Screen
from textual.widgets import Static

from pa_console.tui.rows import WrappedRow
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.row_views import PointedRows, TextRows

Rows = TypeVar("Rows", bound=PointedRows[Any])


class ListScreen(Screen[None], Generic[Rows]):
    """A screen with the table `listing`; a subclass adds the title, the detail and more keys."""

    def __init__(self, listing: Rows) -> None:
        super().__init__()
        self.listing = listing

    def compose(self) -> ComposeResult:
        """Yield the title, the list with its heading, the detail and the keys."""
        yield Static(id="list-title", markup=False)
        with Vertical(id="list-body"):
            yield from self.above_list()
            yield Static(id="list-heading", markup=False)
            yield self.listing
            with VerticalScroll(id="list-detail"):
                yield TextRows(id="list-sheet")
        yield from self.below_body()
        yield KeyFooter()

    def above_list(self) -> ComposeResult:
        """Yield filters and totals, if there are any."""
        yield from ()

    def below_body(self) -> ComposeResult:
        """Yield widgets that can be shown in place of the list, if there are any."""
        yield from ()

    def detail(self) -> tuple[str, Sequence[WrappedRow]]:
        """Return the title and the rows of the detail of the item at the pointer."""
        raise NotImplementedError

    def entitle(self, title: Content) -> None:
        """Set the title of the screen."""
        self.query_one("#list-title", Static).update(title)

    def show_detail(self) -> None:
        """Show the heading of the list, and the detail of the item at the pointer."""
        self.query_one("#list-heading", Static).update(self.listing.heading())
        self.query_one("#list-detail").border_title, rows = self.detail()
        self.query_one("#list-sheet", TextRows).show(tuple(rows))

    def on_resize(self, _event: events.Resize) -> None:
        """Lay out for the new width."""
        self.call_after_refresh(self.show_detail)

    @on(PointedRows.Pointed)
    def _pointed(self, event: PointedRows.Pointed) -> None:
        event.stop()
        self.show_detail()
        self.query_one("#list-detail", VerticalScroll).scroll_home(animate=False)
