"""The MCP server on a port of loopback beside a session, on stdio, and between the two."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import httpx2
from mcp.client.streamable_http import streamable_http_client
from mcp.server import MCPServer
from mcp.server.auth.provider import AccessToken
from mcp.server.stdio import stdio_server
from mcp.shared.message import SessionMessage

from pa_console.http.connections import Listening, served_app
from pa_console.http.guard import MOST_BYTES, Guard
from pa_console.http.tokens import RefusedError, TokenBook
from pa_console.mcp.agents_session import AgentsSession
from pa_console.mcp.server import SCOPE, make_server
from pa_console.schema.events import event as ev

PATH = "/mcp"
MOST_SESSIONS = 16
"""MCP sessions at a time; each takes memory."""


class AgentTokens:
    """Lets in who has a token of the role proposer, and nobody else: an agent is no operator."""

    def __init__(self, tokens: TokenBook) -> None:
        self._tokens = tokens

    async def verify_token(self, token: str) -> AccessToken | None:
        """Return whose token it is; None for one that is unknown, or of a person."""
        try:
            bearer = self._tokens.find(token)
        except (RefusedError, ValueError, OSError):
            return None
        if bearer is None or bearer.role != "proposer":
            return None
        return AccessToken(token=token, client_id=bearer.person, scopes=[SCOPE])


class AgentsPort:
    """Serves agents over HTTP on a socket beside a session, as long as that lasts.

    `take` is given every event of the session, within its event loop.
    """

    def __init__(
        self,
        session: AgentsSession,
        tokens: TokenBook,
        listening: Listening,
        failed: Callable[[Exception], None],
    ) -> None:
        """`failed` is called with a defect, and once when the system has no room."""
        listening.failed = failed
        app = make_server(session, verifier=AgentTokens(tokens)).streamable_http_app(
            streamable_http_path=PATH,
            max_request_body_size=MOST_BYTES,
            max_sessions=MOST_SESSIONS,
        )
        self._app, self._listening = Guard(app, listening, failed), listening
        self._session, self._failed = session, failed
        self._ended = asyncio.Event()
        self._work: asyncio.Task[None] | None = None

    def take(self, event: ev.Event) -> None:
        """Begin to serve with the first event, and end with the last."""
        if self._work is None:
            self._work = asyncio.get_running_loop().create_task(self._serve())
        self._session.take(event)
        if isinstance(event.data, ev.SessionEnded):
            self._ended.set()

    async def _serve(self) -> None:
        try:
            async with served_app(self._app, self._listening, lifespan="on"):
                await self._ended.wait()
        except Exception as error:
            self._failed(error)


async def serve_stdio(server: MCPServer[Any]) -> None:
    """Serve one agent on stdin and stdout, until it closes them."""
    await server.run_stdio_async()


async def bridge(url: str, token: str) -> None:
    """Carry the messages of an agent on stdin and stdout to the server at `url`, and back."""
    headers = {"Authorization": f"Bearer {token}"}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=None) as client,
        streamable_http_client(url, http_client=client) as (answers, requests),
        stdio_server() as (said, told),
        asyncio.TaskGroup() as group,
    ):
        back = group.create_task(_carry(answers, told))
        await _carry(said, requests)
        back.cancel()


async def _carry(source: Any, target: Any) -> None:
    """Carry messages until the source ends; what cannot be read as one is left out."""
    with suppress(asyncio.CancelledError):
        async for message in source:
            if isinstance(message, SessionMessage):
                await target.send(message)
