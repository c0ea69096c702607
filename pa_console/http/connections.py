"""The port of a service: idle connections are closed, and their number is limited.

Every program on this machine can connect, also without a token. If there are too many connections,
those without a token are closed first and those of observers next; an operator always gets in.
"""

import asyncio
import errno
import os
import socket
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import Any, Literal

import uvicorn
from starlette.types import ASGIApp

ADDRESS = "127.0.0.1"
MOST = 128
"""Connections at once. One more takes the place of the oldest of the lowest rank."""
IDLE_S = 10.0
"""A connection without a complete request is closed after this time, in seconds."""
ACCEPTED, QUEUED = 8, 1024
"""Connections accepted in one turn of the event loop, and the length of the kernel's queue.

A request is read some turns after its connection was accepted. Until then MOST other connections
must not be accepted, or they would end it unread.
"""
KEEP_S, END_S = 5, 3
"""Seconds that an idle connection is kept open, and that a request has at the end."""
EXHAUSTED = frozenset((errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM))


class Connection:
    """One accepted connection, with its rank and the time since its last request."""

    def __init__(self, accepted: socket.socket | None, now: float) -> None:
        self._accepted = accepted
        self.requests, self.since, self.quiet_since = 0, now, now
        self.rank = 0
        """0 without a token, 1 with the token of an observer, 2 with one that may command."""

    @property
    def closed(self) -> bool:
        """True if the connection is over."""
        return self._accepted is None or self._accepted.fileno() == -1

    def let_in(self, *, commands: bool) -> None:
        """Note that a token was accepted on it, and whether that token may command."""
        self.rank = 1 + commands

    def end(self) -> None:
        """Shut the connection down; its server then closes it."""
        if self._accepted is not None:
            with suppress(OSError):
                self._accepted.shutdown(socket.SHUT_RDWR)


class Listening(socket.socket):
    """A socket that listens at a port of loopback, and counts its connections.

    It belongs to one event loop, whose servers accept from it. `failed` is called, once, when the
    system has no room for connections.
    """

    def __init__(self, port: int) -> None:
        """Listen at `port`, 0 for a free one; raises OSError."""
        super().__init__(fileno=socket.create_server((ADDRESS, port)).detach())
        self.failed: Callable[[Exception], None] = lambda _error: None
        self._open: dict[Any, Connection] = {}
        self._spare = os.open(os.devnull, os.O_RDONLY)
        self._reported = False

    def accept(self) -> tuple[socket.socket, Any]:
        """Return a new connection; raises BlockingIOError while there is none."""
        try:
            accepted, address = super().accept()
        except OSError as error:
            if error.errno not in EXHAUSTED:
                raise
            self._turn_away(error)
            raise BlockingIOError from error
        if not self._make_room():
            accepted.close()
            raise BlockingIOError
        loop = asyncio.get_running_loop()
        connection = self._open[address] = Connection(accepted, loop.time())
        loop.call_later(IDLE_S, self._look, connection)
        return accepted, address

    def listen(self, backlog: int = QUEUED, /) -> None:
        """Listen with a queue of QUEUED; the event loop asks for one as long as what it accepts."""
        super().listen(max(backlog, QUEUED))

    def close(self) -> None:
        """Listen no more."""
        super().close()
        if self._spare >= 0:
            os.close(self._spare)
            self._spare = -1

    @contextmanager
    def request(self, address: object) -> Generator[Connection]:
        """Yield the connection from `address`; in the context it has a request and is not idle."""
        loop = asyncio.get_running_loop()
        connection = self._open.get(address) or Connection(None, loop.time())
        connection.requests += 1
        try:
            yield connection
        finally:
            connection.requests -= 1
            connection.quiet_since = loop.time()

    def _make_room(self) -> bool:
        """End one of the lowest rank if there are too many; return False if none may be ended."""
        self._open = {where: one for where, one in self._open.items() if not one.closed}
        if len(self._open) < MOST:
            return True
        least = min(self._open, key=lambda where: (self._open[where].rank, self._open[where].since))
        if self._open[least].rank > 1:
            return False
        self._open.pop(least).end()
        return True

    def _look(self, connection: Connection) -> None:
        """End a connection that is idle for too long, else check again when that may be."""
        loop = asyncio.get_running_loop()
        left = IDLE_S if connection.requests else connection.quiet_since + IDLE_S - loop.time()
        if left <= 0:
            connection.end()
        elif not connection.closed:
            loop.call_later(left, self._look, connection)

    def _turn_away(self, error: OSError) -> None:
        """Accept a waiting connection with the spare descriptor, and close it.

        The event loop would otherwise call `accept` again at once, without end.
        """
        if self._spare < 0:
            raise error
        os.close(self._spare)
        self._spare = -1
        try:
            super().accept()[0].close()
        finally:
            with suppress(OSError):
                self._spare = os.open(os.devnull, os.O_RDONLY)
        if not self._reported:
            self._reported = True
            self.failed(OSError(error.errno, f"connections are turned away: {error.strerror}"))


def listen(port: int) -> Listening:
    """Return a socket that listens at `port` of loopback, 0 for a free one.

    Raises ValueError where that cannot be.
    """
    try:
        return Listening(port)
    except OSError as error:
        why = error.strerror or error
        raise ValueError(
            f"--port {port}: {ADDRESS} cannot be listened on there: {why}; choose another port"
        ) from error


class _HttpServer(uvicorn.Server):
    """One that leaves the process's signals to the session, which has to end in order."""

    @contextmanager
    def capture_signals(self) -> Generator[None]:
        yield


@asynccontextmanager
async def served_app(
    app: ASGIApp, listening: Listening, lifespan: Literal["on", "off"] = "off"
) -> AsyncGenerator[str]:
    """Serve `app` on the socket while the context lasts; give the address."""
    config = uvicorn.Config(
        app,
        log_config=None,
        log_level="critical",
        access_log=False,
        lifespan=lifespan,
        ws="none",
        proxy_headers=False,
        server_header=False,
        h11_max_incomplete_event_size=16_384,
        backlog=ACCEPTED,
        timeout_keep_alive=KEEP_S,
        timeout_graceful_shutdown=END_S,
    )
    server = _HttpServer(config)
    work = asyncio.create_task(server.serve([listening]))
    try:
        yield f"http://{ADDRESS}:{listening.getsockname()[1]}"
    finally:
        server.should_exit = True
        await work
