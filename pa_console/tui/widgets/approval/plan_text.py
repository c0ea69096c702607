"""The text of a plan in the approval panel: its rows, and how far it was on screen."""

from collections.abc import Sequence
from typing import NamedTuple

from textual.app import ComposeResult
from textual.containers import VerticalScroll

from pa_console.tui.plan_preview.preview import PlanPreview
from pa_console.tui.widgets.approval.plan_schedule import PlanSchedule
from pa_console.tui.widgets.row_views import Row, TextRows

ROWS_ELSEWHERE = 6
"""The lines of the terminal that are neither map nor panel, about."""

WIDE_SHARE, COMPACT_SHARE = 0.7, 0.62
"""The share of the other lines that the panel may take, beside the map and below it."""

LEAST_ROWS, LEAST_PLAN_ROWS = 13, 4


class PanelRoom(NamedTuple):
    """The largest numbers of rows: for the whole panel, and for the plan in it."""

    panel: int
    plan: int


def panel_room(terminal: int, taken: int, *, compact: bool) -> PanelRoom:
    """Return the room in a terminal of so many rows, of which the panel's other parts have `taken`.

    `compact` says that the panel stands below the map and not beside it.
    """
    share = int((terminal - ROWS_ELSEWHERE) * (COMPACT_SHARE if compact else WIDE_SHARE))
    most = max(share, LEAST_ROWS, taken + LEAST_PLAN_ROWS)
    return PanelRoom(most, most - taken)


class PlanText(VerticalScroll, can_focus=False):
    """The lines of a plan and its schedule; it knows how far they have been read."""

    def __init__(self) -> None:
        super().__init__(id="approval-body")
        self._seen = 0.0
        """The number of lines that have been on screen, from the first on."""
        self._seen_before_play = 0.0
        self._rows = 0

    def compose(self) -> ComposeResult:
        """Yield the lines and the schedule."""
        yield TextRows(id="approval-text")
        yield PlanSchedule(id="approval-schedule")

    def tell(self, rows: Sequence[Row]) -> None:
        """Show these lines; what was on screen counts."""
        self.query_one("#approval-text", TextRows).show(tuple(rows))

    def schedule(self, preview: PlanPreview | None, now_s: float | None = None) -> None:
        """Show who does what when; `now_s` while the rehearsal is played."""
        self.query_one("#approval-schedule", PlanSchedule).show(preview, now_s)

    def begin(self) -> None:
        """Go to the first line; nothing has been read."""
        self.scroll_home(animate=False)
        self._seen = 0.0

    def begin_anew(self) -> None:
        """Count anew: the lines are others, or stand elsewhere."""
        self._seen = 0.0

    def fit(self, rows: int) -> bool:
        """Take at most that many rows of the screen; returns whether their number has changed."""
        if rows == self._rows:
            return False
        self._rows = self.styles.max_height = rows
        if self.scroll_offset.y == 0:  # nothing has been read on yet
            self._seen = 0.0
        return True

    def note_seen(self) -> None:
        """Note which lines are on screen, as far as none before them was left out."""
        if self.scroll_offset.y <= self._seen:
            bottom = self.scroll_offset.y + self.scrollable_content_region.height
            self._seen = max(self._seen, bottom)

    @property
    def read(self) -> bool:
        """True if all lines have been on screen."""
        return 0 < self.query_one("#approval-text").size.height <= self._seen

    def keep(self) -> None:
        """Keep what has been on screen, while a rehearsal is played in its place."""
        self._seen_before_play = self._seen

    def recall(self) -> None:
        """Restore the kept count."""
        self._seen = max(self._seen, self._seen_before_play)

    def scroll_pages(self, pages: int) -> None:
        """Show what follows, or what comes before."""
        step = max(self.scrollable_content_region.height - 1, 1)
        self.scroll_to(y=self.scroll_offset.y + pages * step, animate=False)
