"""A station's connection to the broker, in a thread of its own: no message waits for the screen."""

import asyncio
import threading
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import NamedTuple

from pa_console.fleets.bus.address import BrokerAddress, Credentials
from pa_console.fleets.bus.client import BusClient, Received, Sent, say_nothing
from pa_console.fleets.vda5050.topics import Topic
from pa_console.fleets.vda5050.wire import Header, UnreadableError

MOST_WAITING = 20_000
"""So many messages wait to be taken in; what comes beyond is dropped, and counted."""

GOODBYE_S = 2.0


class Delivery(NamedTuple):
    """A message as read, or why it cannot be read, and when it came (UTC)."""

    topic: Topic
    message: Header | UnreadableError
    retained: bool
    at: datetime


class StationLink:
    """Hears the topics of every robot of a site that `kinds` are read from, and sends."""

    def __init__(
        self,
        address: BrokerAddress,
        name: str,
        kinds: Sequence[type[Header]],
        credentials: Credentials | None = None,
    ) -> None:
        self.address, self._kinds = address, {kind.TOPIC: kind for kind in kinds}
        self._waiting: deque[Delivery] = deque()
        self.dropped = 0
        """How many messages were dropped, as too many had come."""
        self.problem = "not connected yet"
        """Why there is no connection, "" while there is one."""
        self._news, self._up = threading.Event(), threading.Event()
        self._loop, self._ending = asyncio.new_event_loop(), asyncio.Event()
        self._loop.set_exception_handler(say_nothing)
        topics = [f"{address.site}/v3/+/+/{topic}" for topic in self._kinds]
        self._client = BusClient(
            address, name, self._heard, self._changed, topics, credentials=credentials
        )
        self._thread = threading.Thread(target=self._run, name="station link", daemon=True)
        self._thread.start()

    def wait_connected(self, seconds: float) -> bool:
        """Return whether there is a connection within `seconds`."""
        return self._up.wait(seconds)

    def wait_news(self, seconds: float) -> bool:
        """Return whether something is to be taken, within `seconds`."""
        found = self._news.wait(seconds)
        self._news.clear()
        return found or bool(self._waiting)

    def take(self) -> list[Delivery]:
        """Return what has come since the last call, in order."""
        taken: list[Delivery] = []
        while self._waiting:
            taken.append(self._waiting.popleft())
        return taken

    def publish(self, *messages: Sent) -> bool:
        """Send the messages in order; return False, and send none, without a connection."""
        if not self._up.is_set():
            return False
        with suppress(RuntimeError):  # the link is closed
            self._loop.call_soon_threadsafe(self._send, messages)
        return True

    def close(self) -> None:
        """End the connection, once what was sent is out."""
        if self._thread.is_alive():
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._ending.set)
            self._thread.join(GOODBYE_S + 1.0)

    def _send(self, messages: Sequence[Sent]) -> None:
        for message in messages:
            self._client.send(message)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        running = asyncio.create_task(self._client.run())
        ending = asyncio.create_task(self._ending.wait())
        await asyncio.wait((running, ending), return_when=asyncio.FIRST_COMPLETED)
        with suppress(TimeoutError):
            async with asyncio.timeout(GOODBYE_S):
                await self._client.sent()
        for task in (running, ending):
            task.cancel()
        results = await asyncio.gather(running, ending, return_exceptions=True)
        error = results[0]
        if isinstance(error, Exception):
            self._changed(False, f"{type(error).__name__}: {error}")

    def _changed(self, connected: bool, why: str) -> None:
        self.problem = why
        if connected:
            self._up.set()
        else:
            self._up.clear()
        self._news.set()

    def _heard(self, received: Received) -> None:
        topic = Topic.of(received.topic)
        if topic is None or topic.name not in self._kinds:
            return
        if len(self._waiting) >= MOST_WAITING:
            self.dropped += 1
            return
        message: Header | UnreadableError
        try:
            message = self._kinds[topic.name].read(received.payload)
            if (message.manufacturer, message.serial_number) != topic.identity:
                message = UnreadableError("it says that it is another robot's")
        except UnreadableError as error:
            message = error
        self._waiting.append(Delivery(topic, message, received.retained, datetime.now(UTC)))
        self._news.set()
