"""Separates questions from missions at the prompt, and has them answered."""

from pa_console.language.questions import Question
from pa_console.tui.answers.screen import AnswerScreen
from pa_console.tui.controllers.approval import ApprovalController
from pa_console.tui.controllers.commands import CommandController
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.widgets.mission_prompt import MissionPrompt


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
