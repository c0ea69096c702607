"""A model of a few weights, and one question to the process of a model."""

from contextlib import aclosing
from pathlib import Path

from pa_console.llm.backend import GenerationEnd, Request
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.cache import hash_file
from pa_console.llm.models.catalogue import LocalModel
from tests.training.adapters.tiny import write_tiny

ASK = Request(
    role="planner",
    system="You are a planner.",
    user="Where is the gate?",
    grammar="start: /[a-z]{6}/",
    max_tokens=8,
    deadline_s=300,
)


def local_model(path: Path) -> LocalModel:
    """Return the model at `path`, as it is now."""
    return LocalModel("tiny", path, hash_file(path), "chatml", n_ctx=512)


def tiny_model(folder: Path) -> LocalModel:
    """Write a model of a few weights into `folder`."""
    return local_model(write_tiny(folder / "tiny.gguf"))


async def answer(engine: Engine, request: Request = ASK) -> GenerationEnd:
    """Return the end of an answer, whose text is what was streamed before."""
    text = ""
    async with aclosing(engine.generate(request)) as items:
        async for item in items:
            if isinstance(item, GenerationEnd):
                assert item.texts or text == item.text
                return item
            text += item
    raise AssertionError("no GenerationEnd came")
