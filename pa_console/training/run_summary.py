"""What a training run came to, as `run.json` in its folder: for the model card."""

from pathlib import Path

from pa_console.schema.base import StrictModel
from pa_console.training.lora.config import TrainConfig
from pa_console.training.result_files import read_json

SUMMARY, ADAPTER = "run.json", "adapter.gguf"


class RunSummary(StrictModel):
    """A run after its last step; not `finished` when it was stopped and can be gone on with."""

    config: TrainConfig
    finished: bool
    step: int
    steps: int
    minutes: float
    validation_loss: float | None
    validation_right: float | None
    base_sha256: str
    data_sha256: str
    adapter_sha256: str
    versions: dict[str, str]
    machine: tuple[str, ...]


def write_summary(run: Path, summary: RunSummary) -> None:
    """Write `summary` into the folder `run`; raises OSError."""
    (run / SUMMARY).write_text(summary.model_dump_json(indent=2) + "\n", encoding="utf-8")


def read_summary(run: Path) -> RunSummary:
    """Return the summary in the folder `run`; raises ValueError when there is none."""
    return read_json(run / SUMMARY, RunSummary, "run pa-console train planner or judge")
