"""The configuration of a training run: everything that decides its result, as a YAML file."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from pa_console.llm.backend import ChatFormat, ModelError
from pa_console.llm.models.catalogue import Catalog
from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document
from pa_training import CONFIGS


def shipped_config(task: str) -> Path:
    """Return the file of the configuration that a shipped adapter's training begins with."""
    return CONFIGS / f"{task}.yaml"


class TrainConfig(StrictModel):
    """Base, data and schedule of one run; the same config and data give the same adapter.

    That holds on one machine and without `max_minutes`, which ties the schedule to the clock.
    """

    task: Literal["planner", "judge"]
    base: str = Field(description="a model of the catalogue, or a path to a GGUF file")
    data: str = Field(description="training samples, JSON lines")
    validation: str | None = Field(default=None, description="samples that are never trained on")
    start: str | None = Field(
        default=None,
        description="an earlier run to begin from: its folder, or an adapter's file; of a higher "
        "rank, it is cut down to this one's",
    )
    rank: int = Field(default=16, ge=1, le=256)
    stored: Literal["f16", "q8_0"] = Field(
        default="f16", description="of the exported file; q8_0 needs a rank that 32 divides"
    )
    alpha: float = Field(default=32.0, gt=0.0, description="the update is scaled by alpha / rank")
    learning_rate: float = Field(default=8e-4, gt=0.0, description="after the warm-up")
    final_rate: float = Field(default=0.05, ge=0.0, le=1.0, description="of learning_rate")
    warmup_steps: int = Field(default=20, ge=0)
    weight_decay: float = Field(default=0.0, ge=0.0)
    clip: float = Field(default=1.0, gt=0.0, description="largest norm of the whole gradient")
    samples_per_step: int = Field(default=32, ge=1, description="samples of one update")
    readings: float = Field(
        default=0.0,
        ge=0.0,
        le=1.0,
        description="share of the planner's groups of which only the reading is learnt",
    )
    pack_tokens: int = Field(
        default=1536,
        ge=1,
        description="samples of one situation are learnt in packs of so many tokens, behind the "
        "beginning that they share: as many as the memory holds",
    )
    epochs: float = Field(default=1.0, gt=0.0, description="passes over the data")
    steps: int | None = Field(default=None, ge=1, description="instead of epochs")
    max_minutes: float | None = Field(default=None, gt=0.0, description="ends sooner if reached")
    validate_every: int = Field(default=50, ge=1, description="steps")
    validation_samples: int = Field(default=300, ge=1, description="most that are looked at")
    checkpoint_minutes: float = Field(default=5.0, gt=0.0)
    seed: int = 0
    device: Literal["auto", "cpu"] = Field(
        default="auto", description="auto: the GPU, where there is one"
    )
    precision: Literal["auto", "bfloat16", "float32"] = Field(
        default="auto",
        description="of the frozen weights; auto: bfloat16 on a GPU, float32 on a CPU",
    )

    @classmethod
    def load(cls, path: Path) -> "TrainConfig":
        """Read the file at `path`; raises DocumentError."""
        return Document.read(path).parse(cls)

    def without_folders(self) -> "TrainConfig":
        """Return the config with the bare names of its files: folders are this machine's own."""
        files = {
            "base": self.base,
            "data": self.data,
            "validation": self.validation,
            "start": self.start,
        }
        names = {field: Path(name).name for field, name in files.items() if name is not None}
        return self.model_copy(update=names)


def find_base(config: TrainConfig) -> tuple[Path, ChatFormat]:
    """Return the base's file and its chat format.

    Raises ModelError when it is not here, or cannot be cut to its vocabulary, or OSError.
    """
    entry = Catalog.load().get(config.base)
    path = entry.local_file
    if path is None:
        raise ModelError(
            f"model {entry.name} is not on this machine: run `pa-console models pull {entry.name}`"
        )
    return entry.learnt_file(path), entry.chat
