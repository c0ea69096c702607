"""Lines that ask about a session: each is answered as soon as its answer is there."""

import asyncio
from collections.abc import Callable
from typing import Protocol

from pa_console.language.questions import Question
from pa_console.schema.events.intake import QuestionAnswered


class Answering(Protocol):
    """A station, its own or one that was joined, as far as it answers."""

    def question_in(self, text: str) -> Question | None:
        """Return the question about the record in a text; None for any other text."""
        ...

    async def answer(self, question: Question) -> QuestionAnswered:
        """Answer a question."""
        ...


class AskedLines:
    """Has the questions among the lines answered; the lines that follow do not wait for that."""

    def __init__(
        self,
        station: Answering,
        say: Callable[[str], None],
        answered: Callable[[], None] = lambda: None,
    ) -> None:
        """Call `answered` after each answer."""
        self._station, self._say, self._answered = station, say, answered
        self._answering: set[asyncio.Task[None]] = set()

    def take(self, line: str) -> bool:
        """Answer a line that is a question about the record; return whether it is one."""
        question = self._station.question_in(line)
        if question is None:
            return False
        task = asyncio.create_task(self._tell_answer(question))
        self._answering.add(task)
        task.add_done_callback(self._answering.discard)
        return True

    async def all_answered(self) -> None:
        """Wait until every question so far is answered."""
        await asyncio.gather(*self._answering)

    async def _tell_answer(self, question: Question) -> None:
        """Show the answer line by line; a waiting plan goes on waiting."""
        told = await self._station.answer(question)
        for line in told.lines:
            self._say(f"{line.about}: {line.said}")
        self._answered()
