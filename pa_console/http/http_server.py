"""Serves the interface on a port of loopback, beside whatever else the event loop does."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import asynccontextmanager, contextmanager

import uvicorn

from pa_console.http.connections import ADDRESS, BACKLOG, Listening
from pa_console.http.guard import Guard
from pa_console.http.http_app import make_app
from pa_console.http.served_session import ServedSession
from pa_console.http.tokens import TokenBook

KEEP_S = 5
END_S = 3


class _Server(uvicorn.Server):
    """One that leaves the process's signals to the session, which has to end in order."""

    @contextmanager
    def capture_signals(self) -> Generator[None]:
        yield


@asynccontextmanager
async def serving(
    session: ServedSession,
    tokens: TokenBook,
    listening: Listening,
    failed: Callable[[Exception], None],
) -> AsyncGenerator[str]:
    """Serve `session` on the socket while the context lasts; give the address.

    When it is left, streams of events end, and nothing more is answered. `failed` is told of a
    defect, and once of a lack of descriptors.
    """
    port: int = listening.getsockname()[1]
    listening.failed = failed
    app = Guard(make_app(session, tokens, failed), listening, failed)
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
        backlog=BACKLOG,
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
