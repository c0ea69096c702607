"""The connection to a TAK server, with its address and the client certificate for it.

A thread sends, listens and reconnects. PyTAK opens the connection, with or without TLS.
"""

import asyncio
import os
import random
from asyncio import StreamReader, StreamWriter
from collections.abc import Awaitable, Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Self, cast

from pytak import client_functions

from pa_console.network_address import host_and_port, is_this_machine, server_address
from pa_console.schema.text import count, visible_line
from pa_console.tak.cot_event import CotEvent, ping
from pa_console.tak.reports import TakReports

PORTS = {"tcp": 8087, "tls": 8089}
FORM = "tcp://HOST[:PORT] or tls://HOST[:PORT]"
PASSWORD_VARIABLE = "PA_CONSOLE_TAK_PASSWORD"
"""The environment variable with the password of a certificate's key."""
CIPHERS = "DEFAULT"
CONNECT_S = 10.0
STEADY_S = 30.0
"""The duration of a connection after which its loss resets the wait between tries, in seconds."""
STUCK_S = 20.0
"""The time after which a connection is closed if the server accepts no byte, in seconds."""
QUIET_S = 15.0
"""The time without an event after which a ping is sent, in seconds."""
FLUSH_S = 3.0
"""The longest time for sending the waiting events at the end, in seconds."""
GOODBYE_S = 1.0
"""The time that the server has to read the last bytes, in seconds."""
READ_BYTES = 65_536
BYTES_A_SECOND = 4_000_000
"""The most bytes a second that are read from a server, so that a flood cannot occupy a
processor."""
MOST_WAITING = 10_000
"""The most events that wait; the largest world has 2000 assets with a route each."""


@dataclass(frozen=True)
class Certificate:
    """A client's certificate and key, and the authority whose servers it trusts.

    Certificate and key are PEM files, or a single file with both: PEM, or PKCS #12 as issued by TAK
    servers.
    """

    certificate: Path
    key: Path
    ca: Path

    @classmethod
    def of(cls, certificate: Path | None, key: Path | None, ca: Path | None) -> Self | None:
        """Return the certificate, None without options; raise ValueError if one is incomplete."""
        if certificate is None and key is None and ca is None:
            return None
        if certificate is None or ca is None:
            missing = "--tls-cert" if certificate is None else "--tls-ca"
            raise ValueError(
                f"{missing} is missing: TLS needs the client's certificate (--tls-cert) and the "
                "certificate of the authority that issued the server's (--tls-ca)"
            )
        credentials = cls(certificate, key or certificate, ca)
        for option, path in (
            ("--tls-cert", credentials.certificate),
            ("--tls-key", credentials.key),
            ("--tls-ca", credentials.ca),
        ):
            if not path.is_file():
                raise ValueError(f"{option} {path}: there is no such file")
        if not os.environ.get(PASSWORD_VARIABLE) and credentials.locked:
            raise ValueError(f"{credentials.key} is encrypted: set {PASSWORD_VARIABLE}")
        return credentials

    @property
    def locked(self) -> bool:
        """True if the key needs a password."""
        return self.key.suffix == ".p12" or b"ENCRYPTED" in self.key.read_bytes()


@dataclass(frozen=True)
class TakServer:
    """A TAK server that accepts CoT as a stream of XML."""

    host: str
    port: int
    certificate: Certificate | None = None

    @classmethod
    def parse(cls, text: str, certificate: Certificate | None = None) -> Self:
        """Read `tls://host:8089`; raise ValueError that names the problem."""
        parts, host, port = server_address(text, PORTS, "a TAK server", FORM)
        if parts.path.strip("/") or parts.query or parts.fragment or parts.username:
            raise ValueError(f"{text}: only host and port are understood; {FORM}")
        if parts.scheme == "tls" and certificate is None:
            raise ValueError(f"{text} needs --tls-cert and --tls-ca")
        if parts.scheme == "tcp" and certificate is not None:
            raise ValueError(f"{text} is not encrypted, so --tls-cert has no effect; use tls://")
        if ":" in host and certificate is None:
            raise ValueError(f"{text}: without TLS give the name of the host, or its IPv4 address")
        return cls(host, port, certificate)

    @property
    def open_to_all(self) -> bool:
        """True if events leave this machine without encryption."""
        return self.certificate is None and not is_this_machine(self.host)

    @property
    def warning(self) -> str:
        """The warning about a server without encryption."""
        return f"all data sent to {self} can be read and altered on the way; use tls://"

    def settings(self) -> dict[str, str]:
        """Return the server as settings of PyTAK, which needs `%` escaped."""
        settings = {"COT_URL": str(self)}
        if self.certificate is not None:
            given = {
                "PYTAK_TLS_CLIENT_CERT": str(self.certificate.certificate),
                "PYTAK_TLS_CLIENT_KEY": str(self.certificate.key),
                "PYTAK_TLS_CLIENT_CAFILE": str(self.certificate.ca),
                "PYTAK_TLS_CLIENT_CIPHERS": CIPHERS,
                "PYTAK_TLS_CLIENT_PASSWORD": os.environ.get(PASSWORD_VARIABLE, ""),
            }
            settings |= {name: value.replace("%", "%%") for name, value in given.items()}
        return settings

    def __str__(self) -> str:
        scheme = "tcp" if self.certificate is None else "tls"
        return f"{scheme}://{host_and_port(self.host, self.port)}"


Opened = tuple[StreamReader, StreamWriter]
_CONTEXT = cast(Callable[[object], object], client_functions.get_ssl_ctx)
_TLS_SETTINGS = cast(Callable[[dict[str, str]], object], client_functions.get_tls_config)
_OPEN = cast(Callable[[dict[str, str]], Awaitable[Opened]], client_functions.protocol_factory)


class Outbox:
    """Events from any thread that wait to be sent, only the newest one for each thing.

    A full outbox drops the event that has waited longest, so that no caller has to wait.
    """

    def __init__(self, most: int = MOST_WAITING) -> None:
        self._most = most
        self._waiting: dict[str, CotEvent] = {}
        self._lock = Lock()
        self.dropped = 0
        """The number of events that were dropped."""

    def put(self, events: Iterable[CotEvent]) -> None:
        """Add `events` in this order; each replaces a waiting event about the same thing."""
        with self._lock:
            for event in events:
                self._waiting.pop(event.subject, None)
                self._waiting[event.subject] = event
            while len(self._waiting) > self._most:
                del self._waiting[next(iter(self._waiting))]
                self.dropped += 1

    def take(self) -> CotEvent | None:
        """Remove and return the event that has waited longest; None for an empty outbox."""
        with self._lock:
            oldest = next(iter(self._waiting), None)
            return self._waiting.pop(oldest) if oldest is not None else None

    def __len__(self) -> int:
        with self._lock:
            return len(self._waiting)


class TakConnection:
    """A connection that sends CoT events to a server while its `with` block lasts.

    `tell` is called in the thread of the connection with a line about each new state. `uid` names
    the sender in pings.
    """

    def __init__(
        self,
        server: TakServer,
        uid: str,
        tell: Callable[[str], None],
        retry_s: float = 1.0,
        reports: TakReports | None = None,
    ) -> None:
        """Wait `retry_s` seconds after a first failure; the wait doubles after each further one.

        `reports` receives the state of the connection and everything that the server sends. Raises
        ValueError for certificates that cannot be used.
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
        self._reports = reports
        self._first_retry_s, self._most_retry_s = retry_s, 60.0 * retry_s
        self.outbox = Outbox()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._news, self._closing = asyncio.Event(), asyncio.Event()
        self._ready = Event()
        self._state = ""
        self._thread = Thread(target=lambda: asyncio.run(self._run()), name="tak", daemon=True)
        self.connections = 0
        """The number of connections so far; after each, the map must be drawn again."""
        self.sent = 0

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *_error: object) -> None:
        self._wake(self._closing)
        self._wake(self._news)
        self._thread.join(2 * FLUSH_S + GOODBYE_S)

    @property
    def words(self) -> str:
        """The numbers of events that were sent, not sent and dropped, in words."""
        rest = ((len(self.outbox), "not sent"), (self.outbox.dropped, "dropped"))
        more = "".join(f", {number} {state}" for number, state in rest if number)
        return f"{count(self.sent, 'event')} sent{more}"

    def send(self, events: Iterable[CotEvent]) -> None:
        """Send `events` as soon as there is a connection; return at once."""
        self.outbox.put(events)
        self._wake(self._news)

    def _wake(self, event: asyncio.Event) -> None:
        if self._loop is not None:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(event.set)

    async def _run(self) -> None:
        """Connect until the session ends, with a longer wait after each failure in a row."""
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
        """Serve one connection; raise the error that prevented or ended it."""
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
        """Return the opened connection; raise _ClosedError if the session ends first."""
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
        """Send until the session ends; raise OSError or TimeoutError for a lost connection."""
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
        """Return FLUSH_S seconds after the end of the session."""
        await self._closing.wait()
        await asyncio.sleep(FLUSH_S)

    async def _listen(self, reader: StreamReader) -> None:
        """Read the server's bytes until it closes the connection."""
        while data := await reader.read(READ_BYTES):
            if self._reports is not None:
                self._reports.received(data)
            # The pause limits the rate and lets the sender run.
            await asyncio.sleep(len(data) / BYTES_A_SECOND)

    async def _send_all(self, writer: StreamWriter) -> None:
        """Send waiting events as fast as the server accepts them; close at the end."""
        while True:
            self._news.clear()
            last = self._closing.is_set()
            while (event := self.outbox.take()) is not None:
                if self._reports is not None:
                    self._reports.sent(event)
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
                self.outbox.put((ping(self._uid, now, now + timedelta(seconds=QUIET_S)),))
        if writer.can_write_eof():
            writer.write_eof()
        else:
            writer.close()
            await writer.wait_closed()

    def _say(self, line: str, *, connected: bool) -> None:
        """Report a new state, with the number of dropped events."""
        if line == self._state:
            return
        self._state = line
        if self._reports is not None:
            self._reports.connection_changed("connected" if connected else "away", line)
        lost = (
            f"; {count(self.outbox.dropped, 'event')} dropped so far" if self.outbox.dropped else ""
        )
        self._tell(f"{line}{lost}")


class _ClosedError(Exception):
    """Raised if the session ends while a connection is being opened."""


def _why(error: Exception) -> str:
    """Return the cause of `error` in one line."""
    match error:
        case TimeoutError():
            return "no answer in time"
        case SyntaxError() if error.__cause__ is not None:
            return visible_line(f"its certificate is not trusted: {error.__cause__}")
        case OSError() if error.strerror:
            return visible_line(error.strerror)
        case _:
            return visible_line(str(error) or type(error).__name__)
