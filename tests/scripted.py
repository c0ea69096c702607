"""A stand-in for the LLM that says what a test tells it to; it lives under tests/ only."""

import asyncio
import json
from collections.abc import AsyncGenerator, Sequence
from dataclasses import replace
from math import log
from pathlib import Path
from typing import cast

from pa_console.llm.backend import Chance, EngineError, GenerationEnd, Request
from pa_console.llm.local.engine import Engine, OnState
from pa_console.llm.models.catalogue import LocalModel
from pa_console.schema.events.event import Role
from pa_console.schema.finding import Usage

Answer = str | EngineError | None
"""A text, an error to raise, or None for an answer that never comes."""

SUCCESS = '{"rules": [], "feedback": "serves the mission", "verdict": "Success"}'
FAILURE = '{"rules": [], "feedback": "wrong gate", "verdict": "Failure"}'


def plan(*orders: tuple[str, str], reason: str = "scripted") -> str:
    """Return the JSON text of a plan of (agent, command) pairs."""
    actions = [{"agent": agent, "command": command} for agent, command in orders]
    return json.dumps({"reason": reason, "actions": actions})


class ScriptedEngine:
    """Answers the planner's and the judge's prompts from two lists; the last answer repeats."""

    def __init__(
        self,
        plans: Sequence[Answer],
        verdicts: Sequence[Answer] = (SUCCESS,),
        others: Sequence[str] = (),
        chances: Sequence[Chance] = (),
    ) -> None:
        """`others` are what comes when several answers are asked for at once.

        Every single answer comes with `chances`.
        """
        self._others, self._chances = others, tuple(chances)
        self._answers = {"planner": list(plans), "judge": list(verdicts)}
        self.requests: list[Request] = []
        self.several: list[Request] = []
        """Those for several answers at once."""
        self.model = LocalModel("scripted", Path("/dev/null"), "0" * 64)
        self.second_reader: ScriptedEngine | None = None
        self.name = self.sampler = "scripted"
        self.on_state: OnState | None = None
        self.busy, self.state = False, "ready"
        self.warmed: list[tuple[Role, str, str]] = []
        self.kills = 0
        """How often the worker was killed."""

    def engine(self) -> Engine:
        """Return this stand-in where an Engine is asked for."""
        return cast(Engine, self)

    async def start(self) -> None:
        """Report to be ready."""
        if self.on_state is not None:
            self.on_state("ready", "scripted")

    async def warm(self, role: Role, system: str, user: str = "") -> None:
        """Note what was to be read ahead."""
        self.warmed.append((role, system, user))

    async def close(self) -> None:
        """Do nothing."""

    def cancel(self) -> None:
        """Do nothing: a cancelled task stops waiting by itself."""

    def kill_worker(self) -> None:
        """Count the fault; whoever waits for an answer goes on waiting."""
        self.kills += 1

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Give the next answer of the request's role in two pieces."""
        if request.count > 1:
            self.several.append(request)
            texts = tuple(self._others)
            yield GenerationEnd("", Usage(completion_tokens=2, seconds=0.01), "stop", texts)
            return
        self.requests.append(request)
        answers = self._answers["planner" if request.role == "planner" else "judge"]
        answer = answers.pop(0) if len(answers) > 1 else answers[0]
        if isinstance(answer, EngineError):
            raise answer
        if answer is None:
            await asyncio.Event().wait()
            return
        half = len(answer) // 2
        yield answer[:half]
        yield answer[half:]
        usage = Usage(completion_tokens=2, seconds=0.01)
        yield GenerationEnd(answer, usage, "stop", chances=self._chances)


def judged(asked: str, planned: str = "1 drone") -> list[str]:
    """Return what a trained judge says of a plan that fits: how it begins, then all of it."""
    words = json.dumps(f"{asked}; planned: {planned}; it fits")
    whole = f'{{"feedback": {words}, "violated": [], "verdict": "Success"}}'
    return [f'{{"feedback": "{asked}; planned: ', whole]


def sure_engine(asked: str, made: str, place: str) -> ScriptedEngine:
    """Return one that plans `made` for what was `asked` of a place, and has no doubt of that."""
    engine = ScriptedEngine([made], judged(asked), chances=[(made.index(place), log(0.95))])
    engine.model = replace(engine.model, prompts="compact")
    return engine
