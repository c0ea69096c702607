"""The port of a service, with a limit of connections; idle connections are closed.

Every program on this machine can connect, even without a token. If there are too many connections,
those without a token are closed first and those of observers next. An operator always gets in.
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
"""The most connections at a time; one more replaces the oldest of the lowest rank."""
IDLE_S = 10.0
"""The time after which a connection without a complete request is closed, in seconds."""
ACCEPTED, QUEUED = 8, 1024
"""The connections accepted in one turn of the event loop, and the length of the kernel's queue.

A request is read some turns after its connection is accepted. If MOST further connections were
accepted in the meantime, they would close it unread, so fewer are accepted.
"""
KEEP_S, END_S = 5, 3
"""The time that an idle connection is kept open, and that a request has at shutdown, in seconds."""
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
        """True if the connection is closed."""
        return self._accepted is None or self._accepted.fileno() == -1

    def let_in(self, *, commands: bool) -> None:
        """Record that a token was accepted on the connection, and whether the token may command."""
        self.rank = 1 + commands

    def end(self) -> None:
        """Shut down the connection; its server then closes it."""
        if self._accepted is not None:
            with suppress(OSError):
                self._accepted.shutdown(socket.SHUT_RDWR)


class Listening(socket.socket):
    """A socket that listens on a port of loopback and counts its connections.

    It belongs to one event loop, whose servers accept from it. `failed` is called once, when the
    system has no room for more connections.
    """

    def __init__(self, port: int) -> None:
        """Listen on `port`, 0 for a free one; raises OSError."""
        super().__init__(fileno=socket.create_server((ADDRESS, port)).detach())
        self.failed: Callable[[Exception], None] = lambda _error: None
        self._open: dict[Any, Connection] = {}
        self._spare = os.open(os.devnull, os.O_RDONLY)
        self._reported = False

    def accept(self) -> tuple[socket.socket, Any]:
        """Return a new connection; raises BlockingIOError if there is none."""
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
        """Listen with a queue of at least QUEUED; the event loop asks for a shorter one."""
        super().listen(max(backlog, QUEUED))

    def close(self) -> None:
        """Stop listening."""
        super().close()
        if self._spare >= 0:
            os.close(self._spare)
            self._spare = -1

    @contextmanager
    def request(self, address: object) -> Generator[Connection]:
        """Yield the connection from `address`, which counts as busy until the context ends."""
        loop = asyncio.get_running_loop()
        connection = self._open.get(address) or Connection(None, loop.time())
        connection.requests += 1
        try:
            yield connection
        finally:
            connection.requests -= 1
            connection.quiet_since = loop.time()

    def _make_room(self) -> bool:
        """Make room for one more connection; return False if none may be ended."""
        self._open = {where: one for where, one in self._open.items() if not one.closed}
        if len(self._open) < MOST:
            return True
        least = min(self._open, key=lambda where: (self._open[where].rank, self._open[where].since))
        if self._open[least].rank > 1:
            return False
        self._open.pop(least).end()
        return True

    def _look(self, connection: Connection) -> None:
        """End a connection that has been idle for too long; otherwise check again later."""
        loop = asyncio.get_running_loop()
        left = IDLE_S if connection.requests else connection.quiet_since + IDLE_S - loop.time()
        if left <= 0:
            connection.end()
        elif not connection.closed:
            loop.call_later(left, self._look, connection)

    def _turn_away(self, error: OSError) -> None:
        """Accept a waiting connection with the spare descriptor, and close it.

        Otherwise, the event loop would call `accept` again and again.
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
    """Return a socket that listens on `port` of loopback, 0 for a free one.

    Raises ValueError if that is not possible.
    """
    try:
        return Listening(port)
    except OSError as error:
        why = error.strerror or error
        raise ValueError(
            f"--port {port}: cannot listen on {ADDRESS}: {why}; choose another port"
        ) from error


class _HttpServer(uvicorn.Server):
    """A server that leaves the process's signals to the session, which must end in order."""

    @contextmanager
    def capture_signals(self) -> Generator[None]:
        yield


@asynccontextmanager
async def served_app(
    app: ASGIApp, listening: Listening, lifespan: Literal["on", "off"] = "off"
) -> AsyncGenerator[str]:
    """Serve `app` on the socket while the context lasts; yield the address."""
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
