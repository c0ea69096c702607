"""A list in columns with a pointer that posts its moves: for a list with a detail."""

from typing import ClassVar

from textual import events
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.message import Message

from pa_console.tui.status_words import NOTE
from pa_console.tui.widgets.assets import Cells, Layout
from pa_console.tui.widgets.row_views import VirtualRows

MARK = 2
"""Cells of the pointer in front of a row."""


class PointedRows(VirtualRows):
    """The pointer stays on its row when others come; subclasses say what a row's cells are."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("pageup", "page(-1)", "Page up", show=False),
        Binding("pagedown", "page(1)", "Page down", show=False),
        Binding("home", "end(0)", "First", show=False),
        Binding("end", "end(-1)", "Last", show=False),
    ]

    class Pointed(Message):
        """The pointer was moved to a row."""

    def layout_of(self, width: int) -> Layout:
        """Return the columns for `width` cells."""
        raise NotImplementedError

    def cells(self, key: str) -> Cells:
        """Return the cells of the row `key`."""
        raise NotImplementedError

    def row(self, index: int, width: int) -> Content:
        """Return a row with the pointer in front."""
        key = self.keys[index]
        mark = ("▸ ", f"bold {NOTE}") if key == self.cursor else "  "
        line = self.layout_of(width - MARK).line(self.cells(key), width - MARK)
        return Content.assemble(mark, line)

    def heading(self) -> Content:
        """Return the names of the columns at the list's own width."""
        width = max(20, self.scrollable_content_region.width or self.size.width) - MARK
        return Content.assemble("  ", self.layout_of(width).heading(width))

    def point_at(self, key: str) -> None:
        """Move the pointer to a row and post that."""
        super().point_at(key)
        self.post_message(self.Pointed())

    def action_page(self, by: int) -> None:
        """Move the pointer by what fits into the view."""
        self.action_cursor(by * max(1, self.size.height - 1))

    def action_end(self, index: int) -> None:
        """Move the pointer to the first or the last row."""
        if self.keys:
            self.point_at(self.keys[index])

    def on_click(self, event: events.Click) -> None:
        """Point at a row with one click, choose it with two."""
        event.prevent_default()
        index = event.y + self.scroll_offset.y
        if index < len(self.keys):
            self.point_at(self.keys[index])
            if event.chain > 1:
                self.action_choose()
