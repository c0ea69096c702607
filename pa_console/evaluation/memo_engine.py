"""An engine that runs the model once for each distinct prompt, for benchmarks of many runs."""

import hashlib
import re
from collections.abc import AsyncGenerator
from contextlib import aclosing
from pathlib import Path

from pydantic import ValidationError

from pa_console.llm.backend import Chance, GenerationEnd, Request
from pa_console.llm.local.engine import OnState, SessionEngine
from pa_console.llm.models.catalogue import LocalModel
from pa_console.schema.base import StrictModel
from pa_console.schema.events.event import Role, WorkerState
from pa_console.schema.finding import Usage

_MEASURED = re.compile(r"\b\d+ (m|s|%)(?=\W|$)")


class _MemoryLine(StrictModel):
    """One line of the file with answers."""

    key: str
    text: str
    usage: Usage
    texts: tuple[str, ...] = ()
    chances: tuple[Chance, ...] = ()


class MemoEngine:
    """An engine that returns the model's earlier answer to an equal prompt.

    Decoding is greedy, so equal prompts have equal answers. Prompts that differ only in a number of
    metres, seconds or percent also count as equal, unless `exact` is True.
    """

    def __init__(
        self,
        engine: SessionEngine,
        memory: Path | None = None,
        *,
        exact: bool = False,
        reuse: bool = True,
    ) -> None:
        """Store answers in the file `memory` too, so that an interrupted evaluation can resume.

        Without `reuse`, the model runs every time. Raises ValueError if a line of the file is not
        an answer.
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

    @property
    def name(self) -> str:
        """The model's name."""
        return self._engine.name

    @property
    def model(self) -> LocalModel:
        """The model of the engine."""
        return self._engine.model

    @property
    def sampler(self) -> str:
        """The sampling settings of the engine, in words."""
        return self._engine.sampler

    @property
    def state(self) -> WorkerState:
        """The state of the engine."""
        return self._engine.state

    @property
    def busy(self) -> bool:
        """True while the model runs."""
        return self._engine.busy

    async def start(self) -> None:
        """Start loading the model."""
        await self._engine.start()

    async def close(self) -> None:
        """Close the engine."""
        await self._engine.close()

    def kill_worker(self) -> None:
        """Kill the model's process."""
        self._engine.kill_worker()

    @property
    def reads_ahead(self) -> bool:
        """True if the model runs every time, so that reading ahead saves time."""
        return not self._reuse

    async def warm(self, role: Role, system: str, user: str = "") -> None:
        """Let the model read the beginning of the prompts of `role`, unless answers are reused."""
        if self.reads_ahead:
            await self._engine.warm(role, system, user)

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Yield the answer to `request` in pieces, then a GenerationEnd; raises EngineError."""
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
    """Return the file for the second reader's answers beside `memory`."""
    return None if memory is None else memory.with_stem(f"{memory.stem}-second")


def _recall(memory: Path) -> dict[str, GenerationEnd]:
    """Return the answers in `memory` by key; raises ValueError if a line is not an answer."""
    answers: dict[str, GenerationEnd] = {}
    for number, line in enumerate(memory.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            entry = _MemoryLine.model_validate_json(line)
        except ValidationError as error:
            raise ValueError(
                f"{memory}:{number}: this line is not a model's answer; remove the line or the file"
            ) from error
        answers[entry.key] = GenerationEnd(
            entry.text, entry.usage, "stop", entry.texts, entry.chances
        )
    return answers
