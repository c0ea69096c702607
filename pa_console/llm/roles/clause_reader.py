"""Lets a model that was not trained for orders read one: it says what is asked, in clauses alone.

A model of this machine is held to the clauses of the present picture. One on a server cannot be, so
what it says is read with their grammar afterwards, and is no reading otherwise.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import regex

from pa_console.language.clause_grammar import grounded_asked
from pa_console.language.clauses import ASKED
from pa_console.llm.backend import Backend, OnText, Request, ask_model, confidence
from pa_console.llm.roles.clause_prompt import MAX_TOKENS, SCHEMA, reading_prompt
from pa_console.llm.roles.grammar import begun_grammar
from pa_console.llm.roles.judge import OrderRead
from pa_console.llm.roles.prompts import Prompt
from pa_console.schema.events.event import Role
from pa_console.schema.mission import Mission
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World

DEADLINE_S = 60.0


@dataclass(frozen=True)
class ReadingQuestion:
    """A prompt for a reader; what it says matches each of `patterns`, regular expressions."""

    prompt: Prompt
    patterns: Sequence[str]
    """The patterns in Rust's syntax."""

    @property
    def grammar(self) -> str:
        """The grammar of the whole answer."""
        return begun_grammar(self.patterns)


def ask_what_is_asked(world: World, digest: Digest, mission: Mission) -> ReadingQuestion:
    """Return the question for the reading of `mission` in the picture of `digest`."""
    prompt = reading_prompt(world, digest, (), mission)
    return ReadingQuestion(prompt, grounded_asked(world, digest, mission.text))


class ClauseReader:
    """Reads orders with a model of this machine or of a server, in the name of a `role`."""

    def __init__(
        self, engine: Backend, role: Role = "judge", *, deadline_s: float = DEADLINE_S
    ) -> None:
        self._engine, self._deadline_s = engine, deadline_s
        self._role: Role = role

    @property
    def model(self) -> str:
        """The name of the model that answers."""
        return self._engine.name

    async def read(self, asked: ReadingQuestion, on_text: OnText | None = None) -> OrderRead:
        """Return what an order asks, as far as that is in canonical clauses about what there is.

        `on_text` gets the answer in pieces. Never raises EngineError.
        """
        request = Request(
            self._role,
            asked.prompt.system,
            asked.prompt.user,
            asked.grammar,
            MAX_TOKENS,
            self._deadline_s,
            schema=SCHEMA,
        )
        answer = await ask_model(self._engine, request, on_text)
        if answer.error:
            return OrderRead("", answer.error, answer.usage, text=answer.text, fatal=answer.fatal)
        try:
            words = str(json.loads(answer.text)["reason"]).removeprefix(ASKED)
        except (ValueError, KeyError, TypeError):
            error = "its answer is not of the form asked for"
            return OrderRead("", error, answer.usage, text=answer.text)
        read = f"{ASKED}{words}"
        if not all(regex.fullmatch(each, read, flags=regex.V1) for each in asked.patterns):
            error = f"no reading in canonical clauses: {words[:120]}"
            return OrderRead("", error, answer.usage, text=answer.text)
        sure = confidence(answer.chances, answer.text, words)
        return OrderRead(read, "", answer.usage, sure, answer.text)
