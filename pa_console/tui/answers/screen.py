"""The answer to a question, over the console; the plan that waits goes on waiting below it."""

from collections.abc import Iterator, Sequence

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen

from pa_console.schema.events.questions import AnswerLine
from pa_console.tui.status_words import QUIET
from pa_console.tui.trace.rows import Row, row
from pa_console.tui.widgets.row_views import TextRows

LOOKING = "looking at the record, and checking what has to be checked …"
_MOST_LEAD = 15
"""Cells that what a line is about may take."""


def answer_rows(lines: Sequence[AnswerLine]) -> Iterator[Row]:
    """Yield an answer with what each line is about before it, said once where it is the same."""
    width = min(max((len(line.about) for line in lines), default=0), _MOST_LEAD)
    before = ""
    for line in lines:
        about = "" if line.about == before else line.about
        before = line.about
        yield row([(f"{about:<{width}}  ", QUIET)], line.said)


class AnswerScreen(ModalScreen[None]):
    """Shows what was asked and what is answered; nothing can be decided here."""

    BINDINGS = [
        Binding("escape,enter,q", "dismiss", "Back"),
        Binding("pagedown,space", "page(1)", show=False),
        Binding("pageup", "page(-1)", show=False),
    ]

    def __init__(self, question: str, *, waits: bool) -> None:
        """`waits` says whether a plan waits for a decision meanwhile."""
        super().__init__()
        self._question, self._waits = question, waits

    def compose(self) -> ComposeResult:
        """Yield the panel."""
        with VerticalScroll(id="answer"):
            yield TextRows((row("", (LOOKING, QUIET)),), id="answer-rows")

    def on_mount(self) -> None:
        """Name the panel after the question, and let the arrow keys scroll it."""
        panel = self.query_one("#answer", VerticalScroll)
        panel.border_title = Content(self._question)
        waits = "the plan still waits; " if self._waits else ""
        panel.border_subtitle = f"{waits}Esc goes back"
        panel.focus()

    def show(self, lines: Sequence[AnswerLine]) -> None:
        """Show the answer; on a panel that was left, nothing."""
        for rows in self.query("#answer-rows").results(TextRows):
            rows.show(tuple(answer_rows(lines)))

    def action_page(self, pages: int) -> None:
        """Show what follows, or what comes before."""
        panel = self.query_one("#answer", VerticalScroll)
        panel.scroll_relative(y=pages * max(panel.size.height - 1, 1), animate=False)
