"""When a run learns from which pack, and how fast; both follow from config and step alone."""

import math
import random
from collections.abc import Sequence

from pa_console.training.lora.config import TrainConfig
from pa_console.training.lora.tokens import Pack


class Order:
    """Every pack once an epoch, shuffled anew each time."""

    def __init__(self, packs: Sequence[Pack], config: TrainConfig) -> None:
        self._packs, self._seed = packs, config.seed
        self._each = min(config.packs_per_step, len(packs))
        epochs = math.ceil(config.epochs * len(packs) / self._each)
        self.steps = config.steps or epochs
        self._epoch = -1
        self._shuffled: list[int] = []

    def step(self, number: int) -> list[Pack]:
        """Return the packs of step `number` (from 0), the largest first: cores end together."""
        first = number * self._each
        chosen = [self._at(place) for place in range(first, first + self._each)]
        return sorted(chosen, key=lambda pack: -pack.size)

    def _at(self, place: int) -> Pack:
        epoch, index = divmod(place, len(self._packs))
        if epoch != self._epoch:
            self._shuffled = list(range(len(self._packs)))
            random.Random(f"{self._seed}/{epoch}").shuffle(self._shuffled)
            self._epoch = epoch
        return self._packs[self._shuffled[index]]


def learning_rate(config: TrainConfig, step: int, done: float) -> float:
    """Return the rate of `step` (from 0) when `done` of the run (0 to 1) lies behind.

    Linear warm-up, then a cosine down to `final_rate`.
    """
    warm = min(1.0, (step + 1) / (config.warmup_steps + 1))
    fall = 0.5 * (1.0 + math.cos(math.pi * min(1.0, done)))
    return config.learning_rate * warm * (config.final_rate + (1.0 - config.final_rate) * fall)
