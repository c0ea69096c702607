"""What a session log pins of the model that answers."""

from dataclasses import dataclass, field
from pathlib import Path

from pa_console.llm.catalog import LocalModel


@dataclass(frozen=True)
class ModelInfo:
    """What the session log pins of the model; `n_ctx` is exact once the engine is ready.

    `adapters` has the SHA-256 of every adapter by the name of its file.
    """

    name: str
    path: Path
    sha256: str
    n_ctx: int
    description: str
    adapters: dict[str, str] = field(default_factory=dict[str, str])

    @classmethod
    def of(cls, model: LocalModel, n_ctx: int) -> "ModelInfo":
        """Return the facts of `model` in contexts of `n_ctx` tokens, before it is loaded."""
        return cls(
            model.name,
            model.path,
            model.sha256,
            n_ctx,
            model.description,
            {adapter.path.name: adapter.sha256 for adapter in model.adapters},
        )
