"""The judge's verdicts on outcomes (Step 7): nobody waits for one.

Telemetry says whether a plan happened, and the mission goes on, or ends, at once. What the judge
says of the outcome changes nothing of that: it is asked while nobody needs the model, and told as
an event of its own.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Coroutine
from dataclasses import dataclass

from pa_console.llm.backend import CANCELLED
from pa_console.llm.roles.judge import Judgement
from pa_console.llm.roles.role_model import RoleModel, first_answer
from pa_console.orchestrator.mission.services import MissionContext
from pa_console.orchestrator.planning.judging import OutcomeCase, ask_about_outcome
from pa_console.schema.events import event as ev

Start = Callable[[Coroutine[None, None, None]], object]
"""Runs work beside the session."""


@dataclass(frozen=True)
class _Asked:
    """The executed plan `attempt` of the mission of `context`, and what became of it."""

    context: MissionContext
    attempt: int
    case: OutcomeCase


class OutcomeVerdicts:
    """Asks for the verdicts of a session one by one, the oldest first.

    A prompt of a mission interrupts the one that is being given; it is asked for again later.
    """

    def __init__(self, start: Start, *, between_missions: bool) -> None:
        """`start` runs work beside the session.

        `between_missions` alone are verdicts asked for where the world waits for the model: there,
        an operator takes no time to decide, and what a mission takes is to be known.
        """
        self._start, self._between_missions = start, between_missions
        self._waiting: deque[_Asked] = deque()
        self._turn = asyncio.Lock()
        self.all_told = asyncio.Event()
        """Set while no verdict is outstanding."""
        self.all_told.set()

    def ask(self, context: MissionContext, attempt: int, case: OutcomeCase) -> None:
        """Ask the judge, when there is time, whether the executed plan `attempt` succeeded."""
        self._waiting.append(_Asked(context, attempt, case))
        self.all_told.clear()

    def go_on(self) -> None:
        """Ask for outstanding verdicts from now on: the mission does not need the model now."""
        if self._waiting and not self._between_missions and not self._turn.locked():
            self._start(self._go_on())

    async def work(self) -> bool:
        """Ask for every outstanding verdict; False when a mission needed the model before the end.

        What is outstanding then waits for the next call.
        """
        async with self._turn:
            while self._waiting:
                asked = self._waiting[0]
                told = await _judged(asked)
                if told.error == CANCELLED:
                    return False
                self._tell(told)
            return True

    def give_up(self, reason: str) -> None:
        """Emit for every outstanding verdict why there is none."""
        while self._waiting:
            self._tell(unjudged(self._waiting[0].attempt, reason))

    def _tell(self, told: ev.OutcomeJudged) -> None:
        """Emit the oldest outstanding verdict and remove it from the queue."""
        self._waiting.popleft().context.emit(told)
        if not self._waiting:
            self.all_told.set()

    async def _go_on(self) -> None:
        await self.work()


async def _judged(asked: _Asked) -> ev.OutcomeJudged:
    """Return the verdict that was asked for, or why there is none."""
    services = asked.context.services

    async def ask(model: RoleModel) -> Judgement:
        question = ask_about_outcome(model.dialect, services.fleet.world, asked.case)
        return await model.judge.judge(question)

    try:
        found = await first_answer(services.judges, ask, asked.context.turn_to_own)
    except Exception as error:  # a defect must not end the session
        return unjudged(asked.attempt, f"internal error: {type(error).__name__}: {error}")
    return ev.OutcomeJudged(
        attempt=asked.attempt, verdict=found.verdict, error=found.error, usage=found.usage
    )


def unjudged(attempt: int, reason: str) -> ev.OutcomeJudged:
    """Return the event for the outcome of `attempt` when there is no verdict on it."""
    return ev.OutcomeJudged(attempt=attempt, verdict=None, error=reason)
