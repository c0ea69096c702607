"""One question: a worker that dies once is asked again, every other failure is told in words."""

import pytest

from pa_console.llm.backend import (
    EngineDiedError,
    EngineError,
    GenerationEnd,
    ModelAnswer,
    ModelUnavailableError,
    PromptRefusedError,
    Request,
    ask_model,
)
from pa_console.schema.finding import Usage
from tests.scripted import ScriptedEngine

REQUEST = Request("planner", "system", "user", "start: x", 100, 10.0)
DIED = EngineDiedError("the model's process died")


async def asked(engine: ScriptedEngine) -> tuple[str, ModelAnswer]:
    """Return the pieces joined, and the whole answer."""
    pieces: list[str] = []
    answer = await ask_model(engine.engine(), REQUEST, pieces.append)
    return "".join(pieces), answer


async def test_a_worker_that_dies_once_is_asked_again() -> None:
    engine = ScriptedEngine([DIED, "the answer"])
    streamed, answer = await asked(engine)
    assert (streamed, answer.text) == ("the answer", "the answer")
    assert (answer.error, answer.fatal) == ("", False)
    assert engine.requests == [REQUEST, REQUEST]


async def test_a_worker_that_dies_again_is_given_up() -> None:
    engine = ScriptedEngine([DIED])
    _, answer = await asked(engine)
    assert (answer.text, answer.error, answer.fatal) == ("", str(DIED), True)
    assert len(engine.requests) == 2


@pytest.mark.parametrize(
    "error", [ModelUnavailableError("no such file"), PromptRefusedError("too long")]
)
async def test_what_asking_again_cannot_help_is_asked_once(error: EngineError) -> None:
    engine = ScriptedEngine([error, "never"])
    _, answer = await asked(engine)
    assert (answer.error, answer.fatal) == (str(error), True)
    assert len(engine.requests) == 1


async def test_what_a_worker_said_before_it_died_is_no_part_of_the_answer() -> None:
    class Dying(ScriptedEngine):
        """Dies in the middle of its first answer."""

        async def generate(self, request: Request):
            self.requests.append(request)
            yield '{"reason'
            if len(self.requests) == 1:
                raise DIED
            yield '": 1}'
            yield GenerationEnd('{"reason": 1}', Usage(prompt_tokens=7), "stop")

    _, answer = await asked(Dying([]))
    assert (answer.text, answer.usage.prompt_tokens) == ('{"reason": 1}', 7)
