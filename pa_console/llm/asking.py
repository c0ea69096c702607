"""One question to the engine, with every way it can fail turned into words (fail closed)."""

from collections.abc import AsyncGenerator
from contextlib import aclosing
from dataclasses import dataclass

from pa_console.llm.engine import Engine, Request
from pa_console.llm.errors import EngineError
from pa_console.schema.finding import Usage


@dataclass(frozen=True)
class Answer:
    """The whole text of an answer; `error` says why it is not complete."""

    text: str
    usage: Usage
    error: str = ""
    fatal: bool = False


async def ask(engine: Engine, request: Request) -> AsyncGenerator[str | Answer]:
    """Give the answer in pieces, then one Answer; EngineError becomes its `error`."""
    text = ""
    try:
        async with aclosing(engine.generate(request)) as answer:
            async for item in answer:
                if isinstance(item, str):
                    text += item
                    yield item
                    continue
                match item.finish:
                    case "stop":
                        yield Answer(item.text, item.usage)
                    case "length":
                        error = f"the answer was cut off after {request.max_tokens} tokens"
                        yield Answer(item.text, item.usage, error)
                    case "cancelled":
                        yield Answer(item.text, item.usage, "cancelled", fatal=True)
                    case "deadline":
                        error = f"no complete answer within {request.deadline_s:.0f} s"
                        yield Answer(item.text, item.usage, error, fatal=True)
    except EngineError as error:
        yield Answer(text, Usage(), str(error), fatal=True)
