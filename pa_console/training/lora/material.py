"""What a run learns from and what it is validated with: its samples as packs."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from pa_console.training.lora.config import TrainConfig
from pa_console.training.lora.readings import judge_readings, readings
from pa_console.training.lora.shares import drawn
from pa_console.training.lora.tokens import Pack, Tokeniser, make_packs
from pa_console.training.samples import read_samples


def packs_to_learn(config: TrainConfig, tokeniser: Tokeniser) -> list[Pack]:
    """Return the samples of `config`, of a judge also the missions that it learns to read.

    Raises OSError, and ValueError for a file that holds no sample of the task.
    """
    packs = _packs(config, Path(config.data), tokeniser, config.readings, config.shares)
    if config.missions is not None and config.task == "judge":
        missions = read_samples(Path(config.missions), "planner")
        packs += make_packs(judge_readings(missions), tokeniser, config.pack_tokens)
    return packs


def packs_held_out(config: TrainConfig, tokeniser: Tokeniser) -> list[Pack]:
    """Return whole packs of the validation file until there are samples enough."""
    if config.validation is None:
        return []
    kept: list[Pack] = []
    for pack in _packs(config, Path(config.validation), tokeniser):
        if sum(len(p.branches) for p in kept) >= config.validation_samples:
            break
        kept.append(pack)
    return kept


def _packs(
    config: TrainConfig,
    path: Path,
    tokeniser: Tokeniser,
    short: float = 0.0,
    shares: Mapping[str, float] = MappingProxyType({}),
) -> list[Pack]:
    """Return `shares` of the samples of `path` as packs, some cut down to their readings.

    Raises ValueError when there is none of the task.
    """
    samples = drawn(read_samples(path, config.task), shares, config.seed)
    packs = make_packs(readings(samples, short, config.seed), tokeniser, config.pack_tokens)
    if not packs:
        raise ValueError(f"{path}: holds no sample for the {config.task}")
    return packs
