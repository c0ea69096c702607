"""An engine that asks the model once for every distinct prompt, for benchmarks of many runs."""

import hashlib
import re
from collections.abc import AsyncGenerator
from contextlib import aclosing
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from pa_console.llm.backend import Chance, GenerationEnd, Request
from pa_console.llm.local.engine import Engine, OnState
from pa_console.schema.base import StrictModel
from pa_console.schema.events.event import Role
from pa_console.schema.finding import Usage

_MEASURED = re.compile(r"\b\d+ (m|s|%)(?=\W|$)")


class _MemoryLine(StrictModel):
    """One line of the memory file."""

    key: str
    text: str
    usage: Usage
    texts: tuple[str, ...] = ()
    chances: tuple[Chance, ...] = ()


class MemoEngine:
    """An engine that repeats the model's answer when a prompt comes again.

    Decoding is greedy, so an equal prompt has an equal answer. Prompts that differ only in a number
    of metres, seconds or percent count as equal and get the first one's answer, unless only `exact`
    repetitions do.
    """

    def __init__(
        self, engine: Engine, memory: Path | None = None, *, exact: bool = False, reuse: bool = True
    ) -> None:
        """Keep answers in the file `memory` too, so that an interrupted evaluation can go on.

        Without `reuse` the model is asked every time. Raises ValueError for a line of the file
        that is no answer.
        """
        self._engine, self._memory, self._exact = engine, memory, exact
        self._reuse = reuse
        self._answers = _recall(memory) if memory is not None and memory.exists() else {}
        self.asked = 0
        self.reused = 0
        self.second_reader: MemoEngine | None = None
        if engine.second_reader is not None:
            self.second_reader = MemoEngine(
                engine.second_reader, _beside(memory), exact=exact, reuse=reuse
            )
        self.on_state: OnState | None = None

    def engine(self) -> Engine:
        """Return this where an Engine is asked for."""
        return cast(Engine, self)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the model itself, such as its name or whether it is busy."""
        return getattr(self._engine, name)

    @property
    def reads_ahead(self) -> bool:
        """True if reading ahead is worth while: the model is asked every time."""
        return not self._reuse

    async def warm(self, role: Role, system: str, user: str = "") -> None:
        """Read the beginning of prompts of `role` ahead, unless answers are reused."""
        if self.reads_ahead:
            await self._engine.warm(role, system, user)

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Give the answer to `request` in pieces, then one GenerationEnd; raises EngineError."""
        user = request.user if self._exact else _MEASURED.sub(r"# \1", request.user)
        parts = (request.role, request.system, user, request.grammar, str(request.count))
        key = hashlib.sha256("\x00".join(parts).encode()).hexdigest()
        answer = self._answers.get(key) if self._reuse else None
        if answer is not None:
            self.reused += 1
            yield answer.text
            yield answer
            return
        self.asked += 1
        async with aclosing(self._engine.generate(request)) as items:
            async for item in items:
                if isinstance(item, GenerationEnd) and item.finish == "stop":
                    self._remember(key, item)
                yield item

    def _remember(self, key: str, answer: GenerationEnd) -> None:
        self._answers[key] = answer
        if self._memory is not None:
            line = _MemoryLine(
                key=key,
                text=answer.text,
                usage=answer.usage,
                texts=answer.texts,
                chances=answer.chances,
            )
            with self._memory.open("a", encoding="utf-8") as file:
                file.write(line.model_dump_json() + "\n")


def _beside(memory: Path | None) -> Path | None:
    """Return the file of the second reader's answers beside `memory`."""
    return None if memory is None else memory.with_stem(f"{memory.stem}-second")


def _recall(memory: Path) -> dict[str, GenerationEnd]:
    """Return the answers in `memory` by key; raises ValueError for a line that is none."""
    answers: dict[str, GenerationEnd] = {}
    for number, line in enumerate(memory.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            entry = _MemoryLine.model_validate_json(line)
        except ValidationError as error:
            raise ValueError(
                f"{memory}:{number}: this line is no answer of a model; remove it, or the file"
            ) from error
        answers[entry.key] = GenerationEnd(
            entry.text, entry.usage, "stop", entry.texts, entry.chances
        )
    return answers
