"""The connection to a TAK server: a thread that sends, connects again, and delays nobody.

PyTAK opens it, with or without TLS. What the server sends goes to whoever has ears for it; nobody
else reads it.
"""

import asyncio
import random
from asyncio import StreamReader, StreamWriter
from collections.abc import Awaitable, Callable, Iterable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from threading import Event, Thread
from types import TracebackType
from typing import Protocol, Self, cast

from pytak import client_functions

from pa_console.schema.text.quantities import count
from pa_console.schema.text.visible_text import visible_line
from pa_console.tak.cot_event import CotEvent, ping
from pa_console.tak.outbox import Outbox
from pa_console.tak.server import TakServer

Opened = tuple[StreamReader, StreamWriter]
_CONTEXT = cast(Callable[[object], object], client_functions.get_ssl_ctx)
_TLS_SETTINGS = cast(Callable[[dict[str, str]], object], client_functions.get_tls_config)
_OPEN = cast(Callable[[dict[str, str]], Awaitable[Opened]], client_functions.protocol_factory)
CONNECT_S = 10.0
STEADY_S = 30.0
"""After a connection that lasted so long the next one is tried soon."""
STUCK_S = 20.0
"""A server that takes nothing for so long is given up."""
QUIET_S = 15.0
"""After so long without anything to send, the server is asked for a sign of life."""
FLUSH_S = 3.0
"""At the end, what waits is sent for so long at most."""
GOODBYE_S = 1.0
"""A server that was told that nothing more comes has so long to take what is under way."""
READ_BYTES = 65_536
BYTES_A_SECOND = 4_000_000
"""More is not taken from a server: whoever floods it must not keep a processor busy here."""


class Ears(Protocol):
    """What is told of a connection in its own thread: its state, what is sent, what is heard."""

    def connected(self, line: str) -> None:
        """Note that there is a connection, which `line` says."""
        ...

    def away(self, line: str) -> None:
        """Note that there is none, and why."""
        ...

    def sent(self, event: CotEvent) -> None:
        """Note what is about to be sent."""
        ...

    def heard(self, data: bytes) -> None:
        """Take what the server has sent, in pieces of any length."""
        ...


class TakConnection:
    """Sends CoT events to a server while its `with` block lasts; `tell` is told of its state.

    `tell` is called in the thread of the connection, with one line. `uid` names the sender.
    """

    def __init__(
        self,
        server: TakServer,
        uid: str,
        tell: Callable[[str], None],
        retry_s: float = 1.0,
        ears: Ears | None = None,
    ) -> None:
        """`retry_s` is waited after a first failure, and twice as long after each other one.

        Without `ears`, what the server sends is thrown away.

        Raises ValueError for certificates that cannot be used.
        """
        if server.certificate is not None:
            try:
                _CONTEXT(_TLS_SETTINGS(server.settings()))
            except Exception as error:
                why = visible_line(str(error.__cause__ or error))
                raise ValueError(
                    f"{server.certificate.certificate}: cannot be used: {why}"
                ) from None
        self._server, self._uid, self._tell = server, uid, tell
        self._ears = ears
        self._first_retry_s, self._most_retry_s = retry_s, 60.0 * retry_s
        self._outbox = Outbox()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._news, self._closing = asyncio.Event(), asyncio.Event()
        self._ready = Event()
        self._told = ""
        self._thread = Thread(target=lambda: asyncio.run(self._run()), name="tak", daemon=True)
        self.connections = 0
        """How often it was connected: each time the map may have to be drawn anew."""
        self.sent = 0

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._wake(self._closing)
        self._wake(self._news)
        self._thread.join(2 * FLUSH_S + GOODBYE_S)

    @property
    def dropped(self) -> int:
        """How many things were dropped because too many waited."""
        return self._outbox.dropped

    @property
    def waiting(self) -> int:
        """How many events wait."""
        return len(self._outbox)

    @property
    def words(self) -> str:
        """How much was sent, and what was not."""
        rest = ((self.waiting, "not sent"), (self.dropped, "dropped"))
        more = "".join(f", {number} {what}" for number, what in rest if number)
        return f"{count(self.sent, 'event')} sent{more}"

    def send(self, events: Iterable[CotEvent]) -> None:
        """Let `events` be sent as soon as there is a connection; returns at once."""
        self._outbox.put(events)
        self._wake(self._news)

    def _wake(self, event: asyncio.Event) -> None:
        if self._loop is not None:
            with suppress(RuntimeError):  # it is over
                self._loop.call_soon_threadsafe(event.set)

    async def _run(self) -> None:
        """Connect again and again; each failure in a row is waited for longer."""
        self._loop = asyncio.get_running_loop()
        self._ready.set()
        retry_s = self._first_retry_s
        while not self._closing.is_set():
            begun_s = self._loop.time()
            try:
                await self._connect_and_serve()
            except _ClosedError:
                return
            except Exception as error:  # whatever a library raises must not reach a session
                self._say(
                    f"no connection to {self._server}: {_why(error)}; it is tried again",
                    connected=False,
                )
            if self._loop.time() - begun_s > STEADY_S:
                retry_s = self._first_retry_s
            await self._pause(retry_s * random.uniform(0.8, 1.2))
            retry_s = min(retry_s * 2, self._most_retry_s)

    async def _connect_and_serve(self) -> None:
        """Serve one connection; raises whatever kept it from being made, or ended it."""
        reader, writer = await self._unless_closing(self._open())
        self.connections += 1
        self._say(f"connected to {self._server}", connected=True)
        try:
            await self._serve(reader, writer)
        finally:
            writer.transport.abort()

    async def _open(self) -> Opened:
        async with asyncio.timeout(CONNECT_S):
            return await _OPEN(self._server.settings())

    async def _unless_closing(self, opening: Awaitable[Opened]) -> Opened:
        """Return what is opened; raises _ClosedError when nobody waits for that any more."""
        task, closing = asyncio.ensure_future(opening), asyncio.create_task(self._closing.wait())
        await asyncio.wait((task, closing), return_when=asyncio.FIRST_COMPLETED)
        closing.cancel()
        if not task.done():
            task.cancel()
            raise _ClosedError
        return task.result()

    async def _pause(self, seconds: float) -> None:
        try:
            async with asyncio.timeout(seconds):
                await self._closing.wait()
        except TimeoutError:
            pass

    async def _serve(self, reader: StreamReader, writer: StreamWriter) -> None:
        """Send until the session ends; raises OSError or TimeoutError for a lost connection."""
        jobs = [
            asyncio.create_task(job)
            for job in (self._send_all(writer), self._listen(reader), self._overdue())
        ]
        sending, reading, _ = jobs
        done, rest = await asyncio.wait(jobs, return_when=asyncio.FIRST_COMPLETED)
        if sending in done:
            await asyncio.wait((reading,), timeout=GOODBYE_S)
        for job in rest:
            job.cancel()
        ended = await asyncio.gather(*jobs, return_exceptions=True)
        for job, error in zip(jobs, ended, strict=True):
            if job in done and isinstance(error, Exception):
                raise error
        if reading in done and sending not in done:
            raise ConnectionError("the server closed it")

    async def _overdue(self) -> None:
        """Return when what waits at the end has been sent for long enough."""
        await self._closing.wait()
        await asyncio.sleep(FLUSH_S)

    async def _listen(self, reader: StreamReader) -> None:
        """Read what the server sends, until it closes."""
        while data := await reader.read(READ_BYTES):
            if self._ears is not None:
                self._ears.heard(data)
            await asyncio.sleep(len(data) / BYTES_A_SECOND)

    async def _send_all(self, writer: StreamWriter) -> None:
        """Send what waits, again and again, as fast as the server takes it; then say goodbye."""
        while True:
            self._news.clear()
            last = self._closing.is_set()
            while (event := self._outbox.take()) is not None:
                if self._ears is not None:
                    self._ears.sent(event)
                writer.write(event.xml())
                async with asyncio.timeout(STUCK_S):
                    await writer.drain()
                self.sent += 1
            if last:
                break
            try:
                async with asyncio.timeout(QUIET_S):
                    await self._news.wait()
            except TimeoutError:
                now = datetime.now(UTC)
                self._outbox.put((ping(self._uid, now, now + timedelta(seconds=QUIET_S)),))
        if writer.can_write_eof():
            writer.write_eof()
        else:
            writer.close()
            await writer.wait_closed()

    def _say(self, line: str, *, connected: bool) -> None:
        """Tell the state when it is another one; that things were dropped is told with it."""
        if line == self._told:
            return
        self._told = line
        if self._ears is not None:
            (self._ears.connected if connected else self._ears.away)(line)
        lost = f"; {count(self.dropped, 'event')} dropped so far" if self.dropped else ""
        self._tell(f"{line}{lost}")


class _ClosedError(Exception):
    """Nobody waits for the connection any more."""


def _why(error: Exception) -> str:
    """Say in one line what went wrong."""
    match error:
        case TimeoutError():
            return "no answer in time"
        case SyntaxError() if error.__cause__ is not None:
            return visible_line(f"its certificate is not trusted: {error.__cause__}")
        case OSError() if error.strerror:
            return visible_line(error.strerror)
        case _:
            return visible_line(str(error) or type(error).__name__)
