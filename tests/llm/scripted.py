"""A stand-in for the engine that says what a test wants to hear."""

from collections.abc import AsyncGenerator, Sequence

from pa_console.llm.backend import EngineError, GenerationEnd, Request
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import LocalModel


class ScriptedEngine(Engine):
    """Gives `items` in answer to everything; an error among them is raised."""

    def __init__(
        self, model: LocalModel, items: Sequence[str | GenerationEnd | EngineError]
    ) -> None:
        super().__init__(model)
        self.items = items
        self.requests: list[Request] = []

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Give the script, whatever is asked."""
        self.requests.append(request)
        for item in self.items:
            if isinstance(item, EngineError):
                raise item
            yield item
