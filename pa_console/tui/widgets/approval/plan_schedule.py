"""The schedule of the plan that is looked at, laid out for the width there is."""

from textual.content import Content
from textual.geometry import Size
from textual.widget import Widget

from pa_console.tui.plan_preview.preview import PlanPreview
from pa_console.tui.plan_preview.schedule import schedule_lines

TITLE = "Schedule: ━ under way  ─ at the place  1 2 3 guards"

LEAST_WIDTH = 40
"""A chart is never narrower."""


class PlanSchedule(Widget):
    """Shows who does what when; hidden without a plan that was rehearsed."""

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
        """Return the lines of the chart, none without a plan."""
        return schedule_lines(self._preview, width, self._now_s) if self._preview else []

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:  # noqa: ARG002
        """Return the number of lines at `width` cells."""
        return len(self.lines(width))

    def render(self) -> Content:
        """Return the chart."""
        return Content("\n").join(self.lines(self.content_size.width))
