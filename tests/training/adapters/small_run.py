"""What the runs that tests train are: a few steps of a tiny model."""

from pathlib import Path
from typing import Any

from pa_training.adapters.config import TrainConfig
from pa_training.adapters.trainer import Progress


def config(tiny: Path, data: Path, **changed: Any) -> TrainConfig:
    values: dict[str, Any] = {
        "task": "planner",
        "base": str(tiny),
        "data": str(data),
        "validation": str(data),
        "rank": 4,
        "learning_rate": 0.02,
        "warmup_steps": 2,
        "samples_per_step": 8,
        "pack_tokens": 1000,
        "device": "cpu",
        "steps": 8,
        "validate_every": 4,
        "precision": "float32",
    }
    return TrainConfig(**{**values, **changed})


def ignore(_progress: Progress) -> None:
    """Show nothing."""
