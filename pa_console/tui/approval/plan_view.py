"""The text of a plan in the approval panel, the count of lines read, and the schedule.

The schedule is a Gantt chart: it shows when each agent is under way or at work, and the guards of
each gate.
"""

from collections.abc import Iterator, Sequence
from itertools import groupby

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.content import Content
from textual.geometry import Size
from textual.widget import Widget

from pa_console.language.canonical.reading import place_words
from pa_console.tui.plan_preview import PlanPreview
from pa_console.tui.status_words import BAD, CALM, GOOD, NOTE, QUIET
from pa_console.tui.widgets.row_views import TextRows, WrappedRow

MOST_LABEL = 12
LEAST_BARS = 12
"""The minimum number of columns of a chart; with fewer, its bars could not be read."""

MOST_AGENTS = 8
"""The maximum number of agents with a bar; in a larger team, those that arrive last get one."""

_GOES, _WORKS, _DONE, _FAILS, _NOW = "━", "─", "✔", "✘", "▼"
_DIGITS = 9

TITLE = "Schedule: ━ on the way  ─ at work there  1 2 3 guards"
LEAST_WIDTH = 40
"""The minimum width of a chart, in cells."""

ROWS_ELSEWHERE = 6
"""The approximate number of terminal lines that are neither map nor panel."""

WIDE_SHARE, COMPACT_SHARE = 0.7, 0.62
"""The maximum shares of the remaining lines that the panel takes beside and below the map."""

LEAST_ROWS, LEAST_PLAN_ROWS = 13, 4


def schedule_lines(preview: PlanPreview, width: int, now_s: float | None = None) -> list[Content]:
    """Return the chart, `width` cells wide: a time axis, a bar per agent, and a line per gate.

    A bar begins when its agent sets out. It is thick while the agent is on its way and thin while
    it works. A gate's line shows the number of its guards. With `now_s`, the axis marks that
    moment.
    """
    agents = [a for a in dict.fromkeys(preview.plan.agents) if a in preview.ways]
    agents.sort(key=lambda name: preview.arrival_s(name) or 0.0)
    gates = [gate for gate in preview.before.gates if gate in preview.involved]
    labels = [*agents[:MOST_AGENTS], *map(place_words, gates)]
    lead = min(max((len(label) for label in labels), default=0), MOST_LABEL) + 1
    columns = width - lead
    if not labels or columns < LEAST_BARS or preview.duration_s <= 0.0:
        return []
    chart = _Chart(preview, columns)
    lines = [Content(" " * lead) + chart.axis(now_s)]
    shown = agents if len(agents) <= MOST_AGENTS else agents[-MOST_AGENTS:]
    lines += [_label(name, lead) + chart.bar(name) for name in shown]
    lines += [_label(place_words(gate), lead) + chart.guards(gate) for gate in gates]
    return lines


def _label(text: str, width: int) -> Content:
    cut = text if len(text) < width else f"{text[: width - 2]}…"
    return Content.styled(f"{cut:<{width}}", QUIET)


class _Chart:
    """A chart that maps the seconds of a plan to columns."""

    def __init__(self, preview: PlanPreview, columns: int) -> None:
        self._preview, self._columns = preview, columns

    def _column(self, time_s: float) -> int:
        share = time_s / self._preview.duration_s
        return min(max(int(share * self._columns), 0), self._columns - 1)

    def _time_s(self, column: int) -> float:
        return (column + 0.5) / self._columns * self._preview.duration_s

    def axis(self, now_s: float | None) -> Content:
        """Return the time axis: the start and end of the plan, or the moment `now_s`."""
        if now_s is None:
            end = f"{self._preview.duration_s:.0f} s"
            return Content.styled(f"0 s{end:>{self._columns - 3}}", QUIET)
        at, words = self._column(now_s), f"{now_s:.0f} s"
        if at + len(words) + 1 < self._columns:
            text = f"{' ' * at}{_NOW} {words}"
        else:
            text = f"{words} {_NOW}".rjust(at + 1)
        return Content.styled(text.ljust(self._columns), NOTE)

    def bar(self, agent: str) -> Content:
        """Return the bar of an agent; the mark at its end shows whether the agent finished."""
        motion, preview = self._preview.rehearsal.motion, self._preview
        ended_s = motion.ended_s.get(agent, preview.duration_s)
        arrived_s = motion.arrived_s.get(agent, ended_s)
        there, end = self._column(arrived_s), self._column(ended_s)
        leaves = min(self._column(preview.departure_s(agent)), there)
        done = preview.finished(agent)
        mark = (_DONE, GOOD) if done else (_FAILS, BAD)
        bar = (_GOES * (there - leaves), CALM), (_WORKS * (end - there), CALM), mark
        return Content.assemble(" " * leaves, *bar, " " * (self._columns - end - 1))

    def guards(self, gate: str) -> Content:
        """Return the line of a gate, with the number of its guards over time."""
        counts = [
            len(self._preview.guards_at(gate, self._time_s(column)))
            for column in range(self._columns)
        ]
        return Content.assemble(*_runs(counts))


def _runs(counts: Sequence[int]) -> Iterator[tuple[str, str]]:
    """Yield the number of guards at each change, followed by a line until the next change."""
    for count, columns in groupby(counts):
        length = sum(1 for _ in columns)
        digit = str(count) if count <= _DIGITS else "+"
        line = "·" if count else " "
        yield f"{digit}{line * (length - 1)}", "" if count else f"bold {BAD}"


class PlanSchedule(Widget):
    """The schedule of a rehearsed plan; hidden if there is none."""

    DEFAULT_CSS = "PlanSchedule { height: auto; width: 1fr; }"

    def __init__(self, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"))
        self._preview: PlanPreview | None = None
        self._now_s: float | None = None
        self.border_title = TITLE
        self.add_class("-empty")

    def show(self, preview: PlanPreview | None, now_s: float | None = None) -> None:
        """Show another plan, or another moment of it."""
        other = preview is not self._preview
        if other or now_s != self._now_s:
            self._preview, self._now_s = preview, now_s
            self.set_class(not self.lines(LEAST_WIDTH), "-empty")
            self.refresh(layout=other)

    def lines(self, width: int) -> list[Content]:
        """Return the lines of the chart; none without a plan."""
        return schedule_lines(self._preview, width, self._now_s) if self._preview else []

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:  # noqa: ARG002
        """Return the number of lines at `width` cells."""
        return len(self.lines(width))

    def render(self) -> Content:
        """Return the chart."""
        return Content("\n").join(self.lines(self.content_size.width))


def panel_rows(terminal: int, taken: int, *, compact: bool) -> int:
    """Return the maximum number of rows of the panel on a terminal of `terminal` lines.

    The inputs and buttons take `taken` rows; the plan always keeps at least LEAST_PLAN_ROWS.
    `compact` is True if the panel is below the map and not beside it.
    """
    share = int((terminal - ROWS_ELSEWHERE) * (COMPACT_SHARE if compact else WIDE_SHARE))
    return max(share, LEAST_ROWS, taken + LEAST_PLAN_ROWS)


class PlanText(VerticalScroll, can_focus=False):
    """The lines of a plan and its schedule, with a count of the lines that were read."""

    def __init__(self) -> None:
        super().__init__(id="approval-body")
        self._seen = 0.0
        """The number of lines, counted from the first, that have been on screen."""
        self._seen_before_play = 0.0
        self._rows = 0

    def compose(self) -> ComposeResult:
        """Yield the lines and the schedule."""
        yield TextRows(id="approval-text")
        yield PlanSchedule(id="approval-schedule")

    def tell(self, rows: Sequence[WrappedRow]) -> None:
        """Show these lines; the count of read lines is kept."""
        self.query_one("#approval-text", TextRows).show(tuple(rows))

    def schedule(self, preview: PlanPreview | None, now_s: float | None = None) -> None:
        """Show the schedule of a plan; `now_s` is the moment of a playback."""
        self.query_one("#approval-schedule", PlanSchedule).show(preview, now_s)

    def begin(self) -> None:
        """Scroll to the first line, and restart the count of read lines."""
        self.scroll_home(animate=False)
        self._seen = 0.0

    def begin_anew(self) -> None:
        """Restart the count of read lines, because the lines have changed or moved."""
        self._seen = 0.0

    def fit(self, rows: int) -> bool:
        """Take at most `rows` rows of the screen; return whether their number has changed."""
        if rows == self._rows:
            return False
        self._rows = self.styles.max_height = rows
        if self.scroll_offset.y == 0:  # the operator has not scrolled yet
            self._seen = 0.0
        return True

    def note_seen(self) -> None:
        """Count the lines on screen as read, unless lines before them were skipped."""
        if self.scroll_offset.y <= self._seen:
            bottom = self.scroll_offset.y + self.scrollable_content_region.height
            self._seen = max(self._seen, bottom)

    @property
    def read(self) -> bool:
        """True if all lines have been on screen."""
        return 0 < self.query_one("#approval-text").size.height <= self._seen

    def keep(self) -> None:
        """Store the count of read lines while a rehearsal is played in their place."""
        self._seen_before_play = self._seen

    def recall(self) -> None:
        """Restore the stored count."""
        self._seen = max(self._seen, self._seen_before_play)

    def scroll_pages(self, pages: int) -> None:
        """Scroll by a number of pages."""
        step = max(self.scrollable_content_region.height - 1, 1)
        self.scroll_to(y=self.scroll_offset.y + pages * step, animate=False)
