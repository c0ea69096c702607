"""Serves the interface on a port of loopback, beside whatever else the event loop does."""

import asyncio
import socket
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import asynccontextmanager, contextmanager

import uvicorn

from pa_console.service.guard import Guard
from pa_console.service.http_app import make_app
from pa_console.service.served_session import ServedSession
from pa_console.service.tokens import TokenBook

ADDRESS = "127.0.0.1"
KEEP_S = 5
END_S = 3


class _Server(uvicorn.Server):
    """One that leaves the process's signals to the session, which has to end in order."""

    @contextmanager
    def capture_signals(self) -> Generator[None]:
        yield


def listen(port: int) -> socket.socket:
    """Return a socket that listens at `port` of loopback, 0 for a free one.

    Raises ValueError where that cannot be.
    """
    try:
        return socket.create_server((ADDRESS, port))
    except OSError as error:
        why = error.strerror or error
        raise ValueError(
            f"--port {port}: {ADDRESS} cannot be listened on there: {why}; choose another port"
        ) from error


@asynccontextmanager
async def serving(
    session: ServedSession,
    tokens: TokenBook,
    listening: socket.socket,
    failed: Callable[[Exception], None],
) -> AsyncGenerator[str]:
    """Serve `session` on the socket while the context lasts; give the address.

    When it is left, streams of events end, and nothing more is answered. `failed` is told of a
    defect.
    """
    port: int = listening.getsockname()[1]
    app = Guard(make_app(session, tokens, failed), port, failed)
    config = uvicorn.Config(
        app,
        log_config=None,
        log_level="critical",
        access_log=False,
        lifespan="off",
        ws="none",
        proxy_headers=False,
        server_header=False,
        h11_max_incomplete_event_size=16_384,
        timeout_keep_alive=KEEP_S,
        timeout_graceful_shutdown=END_S,
    )
    server = _Server(config)
    work = asyncio.create_task(server.serve([listening]))
    try:
        yield f"http://{ADDRESS}:{port}"
    finally:
        session.end()
        server.should_exit = True
        await work
