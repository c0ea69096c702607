"""Who decides when the next simulation step is due: the wall clock, or whoever waits for it."""

import asyncio
from collections.abc import Callable
from time import perf_counter
from typing import Protocol

MAX_STEPS_AT_ONCE = 20
IDLE_S = 0.005


class Clock(Protocol):
    """Says how many steps to take now."""

    rate: float

    async def due(self, dt_s: float, waiting: Callable[[], bool]) -> int:
        """Wait until steps are due and return their number; `waiting`: someone needs a step."""
        ...


class RealTimeClock:
    """`rate` simulated seconds a second; after a hold-up it does not race to catch up."""

    def __init__(self, rate: float = 1.0) -> None:
        self.rate = rate
        self._owed = 0.0
        self._last = perf_counter()

    async def due(self, dt_s: float, waiting: Callable[[], bool]) -> int:  # noqa: ARG002
        """Sleep about one step; `waiting` makes no difference."""
        await asyncio.sleep(dt_s / max(self.rate, 1.0))
        now = perf_counter()
        self._owed += (now - self._last) * self.rate / dt_s
        self._last = now
        steps = min(int(self._owed), MAX_STEPS_AT_ONCE)
        self._owed = min(self._owed - steps, 1.0)
        return steps


class SteppedClock:
    """As fast as possible while someone waits, else not at all: the world waits for the model."""

    rate = 1.0

    async def due(self, dt_s: float, waiting: Callable[[], bool]) -> int:  # noqa: ARG002
        """Return one step as soon as someone waits for it."""
        await asyncio.sleep(0.0)
        if not waiting():
            await asyncio.sleep(IDLE_S)
        return 1 if waiting() else 0
