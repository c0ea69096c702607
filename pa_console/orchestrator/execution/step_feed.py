"""Passes every simulation step, and the replies that arrived in it, to the followers of a plan."""

import asyncio
from collections.abc import AsyncIterator, Generator, Sequence
from contextlib import contextmanager

from pa_console.schema.command import CommandReply

Step = tuple[int, tuple[CommandReply, ...]]


class StepFeed:
    """One producer (the station's clock), any number of followers; none misses a step."""

    def __init__(self) -> None:
        self._followers: list[asyncio.Queue[Step]] = []

    @property
    def wanted(self) -> bool:
        """True while a follower has taken in every step and waits for the next."""
        return any(queue.empty() for queue in self._followers)

    def publish(self, tick: int, replies: Sequence[CommandReply]) -> None:
        """Hand out one step."""
        for queue in self._followers:
            queue.put_nowait((tick, tuple(replies)))

    @contextmanager
    def follow(self) -> Generator[AsyncIterator[Step]]:
        """Yield an endless iterator over the steps from now on."""
        queue: asyncio.Queue[Step] = asyncio.Queue()
        self._followers.append(queue)
        try:
            yield _drain(queue)
        finally:
            self._followers.remove(queue)


async def _drain(queue: asyncio.Queue[Step]) -> AsyncIterator[Step]:
    while True:
        yield await queue.get()
