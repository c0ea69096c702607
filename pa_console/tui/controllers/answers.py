"""Separates questions from missions at the prompt, and has them answered."""

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen

from pa_console.language.questions import Question
from pa_console.schema.events.intake import QuestionAnswered
from pa_console.tui.controllers.approval import ApprovalController
from pa_console.tui.controllers.commands import CommandController
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.rows import WrappedRow, row
from pa_console.tui.status_words import QUIET
from pa_console.tui.widgets.mission_prompt import MissionPrompt
from pa_console.tui.widgets.row_views import TextRows
from pa_console.tui.widgets.trace_pane import drawn
from pa_console.views.trace_layout import answered

LOOKING = "looking at the record, and checking what has to be checked …"


class AnswerScreen(ModalScreen[None]):
    """Shows a question and its answer; no decision is possible here."""

    BINDINGS = [
        Binding("escape,enter,q", "dismiss", "Back"),
        Binding("pagedown,space", "page(1)", "Further", show=False),
        Binding("pageup", "page(-1)", "Back", show=False),
    ]

    def __init__(self, question: str, *, waits: bool) -> None:
        """Show an answer; `waits` is True if a plan waits for a decision meanwhile."""
        super().__init__()
        self._question, self._waits = question, waits
        self._rows: tuple[WrappedRow, ...] = (row("", (LOOKING, QUIET)),)

    def compose(self) -> ComposeResult:
        """Yield the panel."""
        with VerticalScroll(id="answer"):
            yield TextRows(self._rows, id="answer-rows")

    def on_mount(self) -> None:
        """Name the panel after the question, and let the arrow keys scroll it."""
        panel = self.query_one("#answer", VerticalScroll)
        panel.border_title = Content(f"You asked: {self._question}")
        waits = "the plan still waits; " if self._waits else ""
        panel.border_subtitle = f"{waits}Esc goes back"
        panel.focus()
        self._show()

    def show(self, told: QuestionAnswered) -> None:
        """Show the answer, also where the panel is not there yet; on one that was left, nothing."""
        self._rows = tuple(each for part in answered((told,)) for each in drawn(part)[0].rows)
        self._show()

    def _show(self) -> None:
        for rows in self.query("#answer-rows").results(TextRows):
            rows.show(self._rows)

    def action_page(self, pages: int) -> None:
        """Show what follows, or what comes before."""
        panel = self.query_one("#answer", VerticalScroll)
        panel.scroll_relative(y=pages * max(panel.size.height - 1, 1), animate=False)


class QuestionController:
    """Takes the texts sent at the prompt: a question is answered, any other text is a mission.

    Other plans stand side by side if one of them can be chosen.
    """

    def __init__(
        self, session: ConsoleSession, commands: CommandController, approval: ApprovalController
    ) -> None:
        self._session, self._commands, self._approval = session, commands, approval

    def take(self, text: str) -> None:
        """Answer a question, or submit a mission."""
        station, main = self._session.station, self._session.main
        question = None
        if station is not None and main is not None and self._session.asks:
            self._commands.point()
            question = station.question_in(text)
        if question is None or main is None:
            self._commands.submit(text)
            return
        main.query_one(MissionPrompt).taken(text)
        beside = question.topic == "alternatives" and not self._session.readonly
        if beside and self._approval.compare(question):
            return
        self._ask(question)

    def _ask(self, question: Question) -> None:
        """Show the answer over the console as soon as it is there."""
        current = self._session.state.current
        waits = current is not None and current.approval is not None
        screen = AnswerScreen(question.text, waits=waits)
        self._session.app.push_screen(screen)
        self._session.app.run_worker(
            self._answer(question, screen), group="question", exclusive=True, exit_on_error=False
        )

    async def _answer(self, question: Question, screen: AnswerScreen) -> None:
        station = self._session.station
        if station is not None:
            told = await station.answer(question)
            screen.show(told)
