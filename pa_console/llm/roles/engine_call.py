"""One question to the engine, with every way it can fail turned into words (fail closed)."""

from collections.abc import AsyncGenerator
from contextlib import aclosing
from dataclasses import dataclass

from pa_console.llm.engine.engine import Engine
from pa_console.llm.engine.protocol import Chance, Completed, Request
from pa_console.llm.errors import EngineDiedError, EngineError
from pa_console.schema.finding import Usage


@dataclass(frozen=True)
class ModelAnswer:
    """The whole text of an answer; `error` says why it is not complete."""

    text: str
    usage: Usage
    error: str = ""
    fatal: bool = False
    texts: tuple[str, ...] = ()
    chances: tuple[Chance, ...] = ()


async def ask_model(engine: Engine, request: Request) -> AsyncGenerator[str | ModelAnswer]:
    """Give the answer in pieces, then one Answer; EngineError becomes its `error`.

    When the model's process dies in the middle it is started again and asked once more; what was
    given before is not given twice (decoding is greedy: it comes again).
    """
    given = 0
    for last in (False, True):
        text = ""
        try:
            async with aclosing(engine.generate(request)) as pieces:
                async for item in pieces:
                    if isinstance(item, str):
                        text += item
                        if len(text) > given:
                            yield text[given:]
                            given = len(text)
                    else:
                        yield _answer(item, request)
            return
        except EngineDiedError as error:
            if last:
                yield ModelAnswer(text, Usage(), str(error), fatal=True)
        except EngineError as error:
            yield ModelAnswer(text, Usage(), str(error), fatal=True)
            return


def _answer(item: Completed, request: Request) -> ModelAnswer:
    match item.finish:
        case "stop":
            return ModelAnswer(item.text, item.usage, texts=item.texts, chances=item.chances)
        case "length":
            error = f"the answer was cut off after {request.max_tokens} tokens"
            return ModelAnswer(item.text, item.usage, error)
        case "cancelled":
            return ModelAnswer(item.text, item.usage, "cancelled", fatal=True)
        case "deadline":
            error = f"no complete answer within {request.deadline_s:.0f} s"
            return ModelAnswer(item.text, item.usage, error, fatal=True)
