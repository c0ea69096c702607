"""The screen for the answer to an operator's question."""

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen

from pa_console.schema.events.intake import QuestionAnswered
from pa_console.tui.rows import WrappedRow, row
from pa_console.tui.status_words import QUIET
from pa_console.tui.widgets.row_views import TextRows
from pa_console.tui.widgets.trace_pane import drawn
from pa_console.views.trace_layout import answered

LOOKING = "reading the log and checking the facts …"
"""The text of the screen until the answer is known."""


class AnswerScreen(ModalScreen[None]):
    """A question and its answer; no decision is possible on this screen."""

    BINDINGS = [
        Binding("escape,enter,q", "dismiss", "Back"),
        Binding("pagedown,space", "page(1)", "Further", show=False),
        Binding("pageup", "page(-1)", "Back", show=False),
    ]

    def __init__(self, question: str, *, waits: bool) -> None:
        """Show the answer to `question`; `waits` is True if a plan waits for a decision."""
        super().__init__()
        self._question, self._waits = question, waits
        self._rows: tuple[WrappedRow, ...] = (row("", (LOOKING, QUIET)),)

    def compose(self) -> ComposeResult:
        """Yield the panel."""
        with VerticalScroll(id="answer"):
            yield TextRows(self._rows, id="answer-rows")

    def on_mount(self) -> None:
        """Use the question as the panel's title, and let the arrow keys scroll the panel."""
        panel = self.query_one("#answer", VerticalScroll)
        panel.border_title = Content(f"You asked: {self._question}")
        waits = "the plan still waits; " if self._waits else ""
        panel.border_subtitle = f"{waits}Esc goes back"
        panel.focus()
        self._show()

    def show(self, answer: QuestionAnswered) -> None:
        """Show the answer, now or when the panel is mounted; do nothing if the screen was left."""
        self._rows = tuple(line for part in answered((answer,)) for line in drawn(part)[0].rows)
        self._show()

    def _show(self) -> None:
        for rows in self.query("#answer-rows").results(TextRows):
            rows.show(self._rows)

    def action_page(self, pages: int) -> None:
        """Scroll by a number of pages."""
        panel = self.query_one("#answer", VerticalScroll)
        panel.scroll_relative(y=pages * max(panel.size.height - 1, 1), animate=False)
