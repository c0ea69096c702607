"""Rows for any width: selectable text, lists that lay out only visible rows, and the events."""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Generic, NamedTuple, TypeVar

from textual import events, on
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.geometry import Region, Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.visual import Visual
from textual.widget import Widget

from pa_console.session.state import NOTICES_KEPT
from pa_console.session.state_parts import Notice
from pa_console.tui.rows import WrappedRow, column, layout, row
from pa_console.tui.status_words import NOTE, QUIET, term

Cells = Mapping[str, tuple[str, str]]
"""The text and style of each column."""

NOTES = "notes"
"""The column that takes the remaining room."""

MARK = 2
"""The width of the pointer in front of a row, in cells."""

Item = TypeVar("Item")


class Layout(NamedTuple):
    """Columns of one group of rows, their widths, and the columns to drop first in narrow panes."""

    title: str
    columns: tuple[tuple[str, int], ...]
    dropped_first: tuple[str, ...]

    def fitting(self, width: int) -> tuple[tuple[str, int], ...]:
        """Return the columns that fit into `width` cells."""
        columns = list(self.columns)
        for name in self.dropped_first:
            if sum(cells + 1 for _, cells in columns) - 1 <= width:
                break
            columns = [item for item in columns if item[0] != name]
        return tuple(columns)

    def heading(self, width: int, note: str = "") -> Content:
        """Return the heading: the group's title in the first column, then the columns' names."""
        words = [column(name, cells, QUIET) for name, cells in self.fitting(width)[1:]]
        first = column(self.title, self.columns[0][1], f"bold {QUIET}")
        return Content.assemble(first, *words, (note, QUIET)).truncate(width)

    def line(self, cells: Cells, width: int) -> Content:
        """Return a row; the notes take the remaining room."""
        fields = [column(cells[n][0], room, cells[n][1]) for n, room in self.fitting(width)]
        return Content.assemble(*fields, cells.get(NOTES, "")).truncate(width, ellipsis=True)


class TextRows(Widget):
    """Rows with hanging indents; nothing in them is parsed as markup."""

    DEFAULT_CSS = "TextRows { height: auto; width: 1fr; }"

    def __init__(self, rows: tuple[WrappedRow, ...] = (), **kwargs: str | None) -> None:
        super().__init__(id=kwargs.get("id"), classes=kwargs.get("classes"))
        self._rows = rows
        self._laid_out: tuple[int, Content] | None = None

    def show(self, rows: tuple[WrappedRow, ...]) -> None:
        """Show other rows; showing the same rows again costs nothing."""
        if rows != self._rows:
            self._rows, self._laid_out = rows, None
            self.refresh(layout=True)

    def _at(self, width: int) -> Content:
        if self._laid_out is None or self._laid_out[0] != width:
            self._laid_out = width, Content("\n").join(layout(self._rows, width))
        return self._laid_out[1]

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:  # noqa: ARG002
        """Return the number of lines at `width` cells."""
        return self._at(width).plain.count("\n") + 1 if self._rows else 0

    def get_content_width(self, container: Size, viewport: Size) -> int:  # noqa: ARG002
        """Return the whole width of the container."""
        return container.width

    def render(self) -> Content:
        """Return the laid out rows."""
        return self._at(self.content_size.width)


class VirtualRows(ScrollView):
    """A list with a cursor on one of its keys; a subclass renders the rows of a key.

    A key may have several rows, one below the other. The cursor stays on its key when rows move.
    """

    can_focus = True
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "cursor(-1)", "Up", show=False),
        Binding("down", "cursor(1)", "Down", show=False),
        Binding("enter", "choose", "Choose", show=False),
    ]

    @dataclass
    class RowChosen(Message):
        """Posted for Enter or a click on the row of `key`."""

        rows: "VirtualRows"
        key: str

    def __init__(self, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"))
        self.keys: list[str] = []
        self._painted: dict[int, Content] = {}
        self.cursor = ""

    def row(self, index: int, width: int) -> Content:
        """Return the row at `index`, `width` cells wide."""
        raise NotImplementedError

    def sticky(self, first: int, width: int) -> Content | None:
        """Return the content to show in the top line instead of row `first`, or None."""
        del first, width
        return None

    def selectable(self, key: str) -> bool:
        """Return whether the cursor may be on `key`."""
        return bool(key)

    def set_keys(self, keys: list[str]) -> None:
        """Show rows with these keys; only visible lines that have changed are painted."""
        if len(keys) != len(self.keys):
            self.virtual_size = Size(self._room, len(keys))
        self.keys = keys
        if self.cursor not in keys or not self.selectable(self.cursor):
            self.cursor = next((key for key in keys if self.selectable(key)), "")
        self._repaint()

    def _repaint(self) -> None:
        if not self.is_mounted or not self.size.height:
            self._painted = {}
            return
        width = self.size.width
        changed: list[Region] = []
        for y in range(self.size.height):
            line = self._line(y)
            painted = self._painted.get(y)
            if painted is None or not painted.is_same(line):
                self._painted[y] = line
                changed.append(Region(0, y, width, 1))
        if changed:
            self.refresh(*changed)

    def _line(self, y: int) -> Content:
        first, width = self.scroll_offset.y, self._room
        index = y + first
        if index >= len(self.keys):
            return Content()
        if y == 0 and first and (stays := self.sticky(first, width)) is not None:
            return stays
        line = self.row(index, width)
        if self.has_focus and self.keys[index] == self.cursor:
            line = line.pad_right(max(0, width - line.cell_length)).stylize("reverse")
        return line

    @property
    def _room(self) -> int:
        return max(20, self.scrollable_content_region.width or self.size.width)

    def render_line(self, y: int) -> Strip:
        """Return the visible line `y`."""
        line = self._line(y)
        self._painted[y] = line
        if not line:
            return Strip.blank(self.size.width, self.rich_style)
        return Visual.to_strips(self, line, self.size.width, 1, self.visual_style)[0]

    def on_resize(self, _event: events.Resize) -> None:
        """Lay out for the new width."""
        self._painted = {}
        self.virtual_size = Size(self._room, len(self.keys))
        self.refresh()

    @on(events.Focus)
    @on(events.Blur)
    def _show_cursor(self) -> None:
        """Show the cursor only while the list has the focus."""
        self._repaint()

    def action_cursor(self, by: int) -> None:
        """Move the cursor to the previous or the next key."""
        keys = [key for key in dict.fromkeys(self.keys) if self.selectable(key)]
        if keys:
            at = keys.index(self.cursor) if self.cursor in keys else 0
            self.point_at(keys[min(max(at + by, 0), len(keys) - 1)])

    def point_at(self, key: str) -> None:
        """Put the cursor on `key` and scroll it into view."""
        if key not in self.keys:
            return
        self.cursor = key
        top = self.keys.index(key)
        last = top + self.keys.count(key) - 1
        first, height = self.scroll_offset.y, self.size.height
        if top <= first:
            self.scroll_to(y=max(top - 1, 0), animate=False, immediate=True)
        elif last >= first + height:
            self.scroll_to(y=last - height + 1, animate=False, immediate=True)
        self._repaint()

    def action_choose(self) -> None:
        """Post that the row under the cursor was chosen."""
        if self.cursor:
            self.post_message(self.RowChosen(self, self.cursor))

    def on_click(self, event: events.Click) -> None:
        """Choose the row that was clicked."""
        index = event.y + self.scroll_offset.y
        if index < len(self.keys) and self.selectable(self.keys[index]):
            self.point_at(self.keys[index])
            self.action_choose()

    @property
    def text(self) -> str:
        """All rows as plain text, including those out of view."""
        return "\n".join(self.row(i, self._room).plain for i in range(len(self.keys)))


class PointedRows(VirtualRows, Generic[Item]):
    """A table with a row for each item; the pointer stays on its row when others arrive.

    Subclasses set `COLUMNS` with their minimum widths, and define the cells of a row and the
    columns that grow.
    """

    COLUMNS: ClassVar[Layout]

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("pageup", "page(-1)", "Page up", show=False),
        Binding("pagedown", "page(1)", "Page down", show=False),
        Binding("home", "end(0)", "First", show=False),
        Binding("end", "end(-1)", "Last", show=False),
    ]

    class Pointed(Message):
        """Posted when the pointer is moved to a row."""

    def __init__(self, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self.items: Mapping[str, Item] = {}

    @property
    def item(self) -> Item | None:
        """The item at the pointer."""
        return self.items.get(self.cursor)

    def show_items(self, items: Mapping[str, Item]) -> None:
        """Show these items by their keys."""
        self.items = dict(items)
        self.set_keys(list(self.items))

    def grown(self, room: int) -> Mapping[str, int]:
        """Return the number of cells of the remaining `room` that each growing column gets."""
        raise NotImplementedError

    def cells(self, key: str) -> Cells:
        """Return the cells of the row `key`."""
        raise NotImplementedError

    def layout_of(self, width: int) -> Layout:
        """Return the columns for `width` cells."""
        columns = self.COLUMNS.fitting(width - 1)
        more = self.grown(max(0, width - sum(cells + 1 for _, cells in columns)))
        shown = tuple((name, cells + more.get(name, 0)) for name, cells in columns)
        return Layout(shown[0][0], shown, ())

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
        """Move the pointer to a row and post the move."""
        super().point_at(key)
        self.post_message(self.Pointed())

    def action_page(self, by: int) -> None:
        """Move the pointer by a number of pages."""
        self.action_cursor(by * max(1, self.size.height - 1))

    def action_end(self, index: int) -> None:
        """Move the pointer to the first or the last row."""
        if self.keys:
            self.point_at(self.keys[index])

    def on_click(self, event: events.Click) -> None:
        """Point at a row on one click, and choose it on two."""
        event.prevent_default()
        index = event.y + self.scroll_offset.y
        if index < len(self.keys):
            self.point_at(self.keys[index])
            if event.chain > 1:
                self.action_choose()


class EventList(ScrollView):
    """The events, newest last; long lines wrap.

    Events that only the simulation can see are left out, unless `all_known` (in a replay).
    """

    can_focus = True

    def __init__(self, *, all_known: bool = False, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"))
        self._all_known = all_known
        self._shown: deque[Notice] = deque(maxlen=NOTICES_KEPT)
        self._rows: list[WrappedRow] = []
        self._lines: list[Content] = []
        self._laid_out = 0
        self._ending, self._at_end = False, True
        self.border_title = "Events"

    def show(self, notices: Iterable[Notice]) -> None:
        """Show these notices; if notices were only added at the end, lay out only the new ones."""
        given = [notice for notice in notices if self._all_known or not notice.hidden]
        added = given[len(self._shown) :]
        if given[: len(self._shown)] != list(self._shown):
            self._shown.clear()
            self._rows, self._lines, added = [], [], given
        elif not added:
            return
        self._shown.extend(added)
        fresh = [notice_row(notice) for notice in added]
        self._rows += fresh
        self._lines += layout(fresh, self._width())
        self._resized()

    def on_resize(self, _event: events.Resize) -> None:
        """Wrap everything for the new width."""
        self._lay_out()
        self._resized()

    def _lay_out(self) -> None:
        self._laid_out = self._width()
        self._lines = layout(self._rows, self._laid_out)

    def _width(self) -> int:
        return max(20, self.scrollable_content_region.width or self.size.width)

    def _resized(self) -> None:
        # only scrolling leaves the end of the list; a pane that shrinks does not
        following = self._at_end or self.scroll_offset.y >= self.max_scroll_y - 1
        self.virtual_size = Size(self._width(), len(self._lines))
        if following and not self._ending:
            self._ending = True
            self.call_after_refresh(self._to_end)
        self.refresh()

    def watch_scroll_y(self, old_value: float, new_value: float) -> None:
        """Follow the end of the list only while the list is scrolled there."""
        super().watch_scroll_y(old_value, new_value)
        self._at_end = new_value >= self.max_scroll_y - 1

    def _to_end(self) -> None:
        self._ending = False
        if self._width() != self._laid_out:  # a scrollbar has appeared or disappeared
            self._lay_out()
            self.virtual_size = Size(self._laid_out, len(self._lines))
        self.scroll_end(animate=False, immediate=True, force=True)
        self.vertical_scrollbar.position = self.scroll_offset.y  # also if it has just appeared

    def render_line(self, y: int) -> Strip:
        """Return the visible line at `y`."""
        index, width = y + self.scroll_offset.y, self.size.width
        if index >= len(self._lines):
            return Strip.blank(width, self.rich_style)
        strips = Visual.to_strips(self, self._lines[index], width, 1, self.visual_style)
        return strips[0]

    @property
    def text(self) -> str:
        """All lines as plain text."""
        return "\n".join(line.plain for line in self._lines)


def notice_row(notice: Notice) -> WrappedRow:
    """Return a notice as time, level sign, subject and text; an alarm has its level as a word."""
    mark = term("level", notice.level)
    word = f"{mark.word} " if notice.level == "alarm" else ""
    lead = [(f"{notice.t:%H:%M:%S} ", QUIET), (f"{mark.glyph} ", mark.style)]
    return row(lead, (word, f"bold {mark.style}"), (f"{notice.subject} ", "bold"), notice.text)
