"""The session's events for several readers, each at its own pace, from any event on."""

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from pa_console.schema.events.event import Event
from pa_console.session.log.chain import read_log

KEPT = 1000
"""The number of recent events kept in memory; older ones are read from the log."""
PIECE = 200
"""The number of events read from the log at a time: unwritten ones are in memory."""
SILENT_S = 15.0
"""The silence after which a reader gets a sign of life of the session, seconds."""


class Numbered(NamedTuple):
    """An event with its number among the logged ones, from 1."""

    number: int
    event: Event


class EventFeed:
    """Keeps the events given to `put` for the readers that `follow`.

    It has the events of the log: transient ones are left out. No reader is waited for: one that
    falls behind goes on from the log.
    """

    def __init__(self, log: Callable[[], Path | None], number: int = 0) -> None:
        """`log` is where the session's log is, None for none; it has `number` events so far."""
        self._log, self.number = log, number
        self._last: deque[Event] = deque(maxlen=KEPT)
        self._changed = asyncio.Event()
        self._ended = False

    def put(self, event: Event) -> None:
        """Take one more event, which the log has."""
        if event.data.transient:
            return
        self.number += 1
        self._last.append(event)
        self._wake()

    def end(self) -> None:
        """Let every reader end that has read all."""
        self._ended = True
        self._wake()

    async def follow(self, after: int) -> AsyncGenerator[Numbered | None]:
        """Yield every event after the one with the number `after`, and None while none comes.

        Raises LogError when the log, which is read for what is older, cannot be.
        """
        number = min(after, self.number)
        while True:
            gone = self.number - len(self._last)
            if number < gone:
                async for item in self._from_log(number, gone):
                    yield item
                number = gone
                continue
            for event in list(islice(self._last, number - gone, None)):
                number += 1
                yield Numbered(number, event)
            if number < self.number:
                continue
            if self._ended:
                return
            try:
                await asyncio.wait_for(self._changed.wait(), SILENT_S)
            except TimeoutError:
                yield None

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    async def _from_log(self, after: int, until: int) -> AsyncGenerator[Numbered]:
        """Yield what the log has between two numbers, the latter included."""
        path = self._log()
        if path is None:
            return
        told = enumerate(read_log(path), start=1)
        wanted = (Numbered(number, event) for number, event in told if number > after)
        while piece := await asyncio.to_thread(_some, wanted):
            for item in piece:
                if item.number > until:
                    return
                yield item


def _some(items: Iterator[Numbered]) -> list[Numbered]:
    return list(islice(items, PIECE))
