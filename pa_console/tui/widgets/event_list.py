"""The event list: virtual, bounded, and following the newest only when the end is in view."""

from collections import deque
from collections.abc import Iterable

from textual import events
from textual.content import Content
from textual.geometry import Size
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.visual import Visual

from pa_console.session.state import NOTICES_KEPT, Notice
from pa_console.tui.rows import WrappedRow, layout, row
from pa_console.tui.status_words import QUIET, term


class EventList(ScrollView):
    """The events, newest last; long lines wrap.

    Events that only the simulation knows are left out, unless `all_known` (in a replay).
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
        """Show these notices; when nothing but new ones were added, only those are laid out."""
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
        # where it was scrolled to last counts: fewer rows for the pane are no scrolling away
        following = self._at_end or self.scroll_offset.y >= self.max_scroll_y - 1
        self.virtual_size = Size(self._width(), len(self._lines))
        if following and not self._ending:
            self._ending = True
            self.call_after_refresh(self._to_end)
        self.refresh()

    def watch_scroll_y(self, old_value: float, new_value: float) -> None:
        """Follow the end from now on, or no longer, as the list is scrolled there or away."""
        super().watch_scroll_y(old_value, new_value)
        self._at_end = new_value >= self.max_scroll_y - 1

    def _to_end(self) -> None:
        self._ending = False
        if self._width() != self._laid_out:  # a scrollbar has come or gone
            self._lay_out()
            self.virtual_size = Size(self._laid_out, len(self._lines))
        self.scroll_end(animate=False, immediate=True, force=True)
        self.vertical_scrollbar.position = self.scroll_offset.y  # also when it has just come

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
    """Return a notice as time, level sign, subject and text; the level is a word in alarms."""
    mark = term("level", notice.level)
    word = f"{mark.word} " if notice.level == "alarm" else ""
    lead = [(f"{notice.t:%H:%M:%S} ", QUIET), (f"{mark.glyph} ", mark.style)]
    return row(lead, (word, f"bold {mark.style}"), (f"{notice.subject} ", "bold"), notice.text)
