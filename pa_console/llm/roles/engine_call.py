"""One question to the engine, with every way it can fail turned into words (fail closed)."""

from collections.abc import Callable
from contextlib import aclosing
from dataclasses import dataclass

from pa_console.llm.engine.protocol import Answering, Chance, Completed, Request
from pa_console.llm.errors import EngineDiedError, EngineError
from pa_console.schema.finding import Usage

CANCELLED = "cancelled"
"""The error of an answer that was interrupted."""

OnText = Callable[[str], object]
"""Is given an answer piece by piece while it is written."""


@dataclass(frozen=True)
class ModelAnswer:
    """The whole text of an answer; `error` says why it is not complete."""

    text: str
    usage: Usage
    error: str = ""
    fatal: bool = False
    texts: tuple[str, ...] = ()
    chances: tuple[Chance, ...] = ()


async def ask_model(
    engine: Answering, request: Request, on_text: OnText | None = None
) -> ModelAnswer:
    """Return the whole answer, which `on_text` gets in pieces; EngineError becomes its `error`.

    When the model's process dies in the middle it is started again and asked once more; what was
    given before is not given twice (decoding is greedy: it comes again).
    """
    given, again = 0, False
    while True:
        text = ""
        whole = ModelAnswer(text, Usage(), "the model ended without an answer", fatal=True)
        try:
            async with aclosing(engine.generate(request)) as pieces:
                async for item in pieces:
                    if isinstance(item, Completed):
                        whole = _answer(item, request)
                        continue
                    text += item
                    if on_text is not None and len(text) > given:
                        on_text(text[given:])
                    given = max(given, len(text))
        except EngineDiedError as error:
            if again:
                return ModelAnswer(text, Usage(), str(error), fatal=True)
            again = True
        except EngineError as error:
            return ModelAnswer(text, Usage(), str(error), fatal=True)
        else:
            return whole


def _answer(item: Completed, request: Request) -> ModelAnswer:
    match item.finish:
        case "stop":
            return ModelAnswer(item.text, item.usage, texts=item.texts, chances=item.chances)
        case "length":
            error = f"the answer was cut off after {request.max_tokens} tokens"
            return ModelAnswer(item.text, item.usage, error)
        case "cancelled":
            return ModelAnswer(item.text, item.usage, CANCELLED, fatal=True)
        case "deadline":
            error = f"no complete answer within {request.deadline_s:.0f} s"
            return ModelAnswer(item.text, item.usage, error, fatal=True)
