"""The MCP server: its tools and resources, and its connections by port or stdio."""

import asyncio
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from typing import Annotated, Any

import httpx2
from mcp.client.streamable_http import streamable_http_client
from mcp.server import MCPServer
from mcp.server.auth.middleware.auth_context import get_access_token
from mcp.server.auth.provider import AccessToken, TokenVerifier
from mcp.server.auth.settings import AuthSettings
from mcp.server.elicitation import AcceptedElicitation, ElicitationResult
from mcp.server.mcpserver import Context
from mcp.server.mcpserver.exceptions import ResourceNotFoundError, ToolError
from mcp.server.mcpserver.resolve import Elicit, Resolve
from mcp.server.stdio import stdio_server
from mcp.server.subscriptions import InMemorySubscriptionBus, ResourceUpdated
from mcp.shared.message import SessionMessage
from mcp_types import ToolAnnotations
from pydantic import AnyHttpUrl, BaseModel, Field

from pa_console import __version__
from pa_console.http.connections import Listening, served_app
from pa_console.http.guard import MOST_BYTES, Guard
from pa_console.http.tokens import RefusedError, TokenBook
from pa_console.mcp.agents_session import (
    MISSIONS,
    PICTURE,
    RULES,
    AgentsSession,
    AssetView,
    ExaminedPlan,
    FoundRules,
)
from pa_console.schema.events import event as ev
from pa_console.schema.mission import MAX_MISSION_TEXT
from pa_console.schema.plan import MAX_ACTIONS, MAX_REASON, Action
from pa_console.views.session_views import MissionDetail, MissionView, StateView

SCOPE = "propose"
ABOUT = """\
A team of robots at a checkpoint, commanded by a person at PA Console.

You may look, ask, examine plans and propose missions. A person decides about every proposal: no \
tool approves, overrides, releases, edits rules or signs. Follow a proposal with mission_status. \
`stop` makes every robot hold at once; only a person releases that.
"""
LOOKS = ToolAnnotations(read_only_hint=True, open_world_hint=False)
PROPOSES = ToolAnnotations(read_only_hint=False, destructive_hint=False, open_world_hint=False)
WITHDRAWS = ToolAnnotations(
    read_only_hint=False, destructive_hint=False, idempotent_hint=True, open_world_hint=False
)
STOPS = ToolAnnotations(
    read_only_hint=False, destructive_hint=True, idempotent_hint=True, open_world_hint=False
)

Words = Annotated[str, Field(min_length=1, max_length=MAX_MISSION_TEXT)]
Actions = Annotated[
    tuple[Action, ...],
    Field(
        min_length=1,
        max_length=MAX_ACTIONS,
        description='such as {"agent": "Drone_T04", "command": "observe EastGate"}',
    ),
]
Purpose = Annotated[
    str, Field(max_length=MAX_MISSION_TEXT, description="the order that the plan is to serve")
]
PATH = "/mcp"
MOST_SESSIONS = 16
"""The most MCP sessions at a time; each takes memory."""


class Meant(BaseModel):
    """The meaning of an unclear part of an order."""

    answer: str = Field(description="one of the choices, or the name of an asset or a place")


def make_server(
    session: AgentsSession, agent: str = "", verifier: TokenVerifier | None = None
) -> MCPServer[Any]:
    """Return the server for `agent`, or for the agents whose requests `verifier` admits."""
    bus = InMemorySubscriptionBus()
    # Tokens are made by `serve --make-token`; no authorization server issues them.
    settings = AuthSettings(
        issuer_url=AnyHttpUrl("http://127.0.0.1"), resource_server_url=None, required_scopes=[SCOPE]
    )
    server = MCPServer[Any](
        "pa-console",
        title="PA Console",
        instructions=ABOUT,
        version=__version__,
        token_verifier=verifier,
        auth=settings if verifier is not None else None,
        log_level="CRITICAL",
        subscriptions=bus,
    )

    def who() -> str:
        token = get_access_token()
        return token.client_id if token is not None else agent

    _add_looking(server, session)
    _add_proposing(server, session, who)
    _add_resources(server, session)
    session.changed = _Updates(bus).changed
    return server


def _add_looking(server: MCPServer[Any], session: AgentsSession) -> None:
    """Add the tools that change nothing."""

    @server.tool(annotations=LOOKS)
    async def picture() -> StateView:
        """Return the present state: assets, tracks, gates, alarms, the queue, and the stop."""
        return session.picture()

    @server.tool(annotations=LOOKS)
    async def describe_asset(name: str) -> AssetView:
        """Return the latest report of an asset, and the commands that it can carry out."""
        with _refusal_as_error():
            return session.describe_asset(name)

    @server.tool(annotations=LOOKS)
    async def rules(search: str = "", rule_id: str = "") -> FoundRules:
        """Return the rules in force: one by its id, the ten that match a search best, or all."""
        with _refusal_as_error():
            return session.rules(search, rule_id)

    @server.tool(annotations=LOOKS)
    async def ask(text: Words) -> ev.QuestionAnswered:
        """Ask about the record, such as *Why?* or *Why is the north gate uncovered?*."""
        with _refusal_as_error():
            return await session.ask(text)

    @server.tool(annotations=LOOKS)
    async def check_plan(actions: Actions, purpose: Purpose = "") -> ExaminedPlan:
        """Check a plan against every rule in the present picture; nothing is queued."""
        with _refusal_as_error():
            return await session.examine(actions, purpose, rehearsed=False)

    @server.tool(annotations=LOOKS)
    async def rehearse_plan(actions: Actions, purpose: Purpose = "") -> ExaminedPlan:
        """Check a plan and return its rehearsal, gate by gate; nothing is queued."""
        with _refusal_as_error():
            return await session.examine(actions, purpose, rehearsed=True)

    @server.tool(annotations=LOOKS)
    async def mission_status(mission_id: str) -> MissionDetail:
        """Return a mission with its plans, their findings, the decisions, and its outcome."""
        with _refusal_as_error():
            return session.status(mission_id)


def _add_proposing(server: MCPServer[Any], session: AgentsSession, who: Callable[[], str]) -> None:
    """Add the tools that propose, withdraw and stop."""

    def what_is_meant(text: str, ctx: Context[Any, Any]) -> Meant | Elicit[Meant]:
        unclear = session.unclear(text)
        able = ctx.client_capabilities
        if unclear is None or able is None or able.elicitation is None:
            return Meant(answer="")
        choices = f" Choices: {', '.join(unclear.choices)}" if unclear.choices else ""
        return Elicit(f"{unclear.question}{choices}", Meant)

    @server.tool(annotations=PROPOSES)
    async def propose_mission(
        text: Words, meant: Annotated[ElicitationResult[Meant], Resolve(what_is_meant)]
    ) -> MissionView:
        """Propose a mission in plain words; a person decides on the plan made for it.

        Name assets and places: your words are read without the earlier orders of others.
        """
        with _refusal_as_error():
            return session.propose(who(), _clear(session, text, meant))

    @server.tool(annotations=PROPOSES)
    async def propose_plan(
        purpose: Words,
        actions: Actions,
        reason: Annotated[str, Field(max_length=MAX_REASON // 2)] = "",
    ) -> MissionView:
        """Propose your own plan for a purpose; it is checked and judged, and a person decides."""
        with _refusal_as_error():
            return session.propose(who(), purpose, actions, reason)

    @server.tool(annotations=WITHDRAWS)
    async def withdraw(mission_id: str) -> str:
        """Withdraw a proposal of yours that has not been approved yet."""
        with _refusal_as_error():
            session.withdraw(who(), mission_id)
        return f"{mission_id} is withdrawn"

    @server.tool(annotations=STOPS)
    async def stop() -> str:
        """Stop every asset at once and end every mission; only a person releases the stop."""
        with _refusal_as_error():
            session.stop(who())
        return "every asset was sent a hold; mission_status and picture show what telemetry reports"


def _clear(session: AgentsSession, text: str, meant: ElicitationResult[Meant]) -> str:
    """Return the text with the answer in place of its unclear part.

    Raises ValueError if there is no answer.
    """
    unclear = session.unclear(text)
    if unclear is None:
        return text
    answer = meant.data.answer.strip() if isinstance(meant, AcceptedElicitation) else ""
    if not answer:
        choices = f"; it may mean {', '.join(unclear.choices)}" if unclear.choices else ""
        raise ValueError(f"not proposed: {unclear.question}{choices}")
    if unclear.words and unclear.words in text:
        return text.replace(unclear.words, answer, 1)
    return f"{text} ({answer})"


def _add_resources(server: MCPServer[Any], session: AgentsSession) -> None:
    """Add the resources that agents read and follow by address."""

    @server.resource(PICTURE, mime_type="application/json")
    async def picture_now() -> str:
        """Return the present state of the session."""
        return session.picture().model_dump_json()

    @server.resource(RULES, mime_type="application/json")
    async def rules_in_force() -> str:
        """Return every rule in force."""
        return session.rules().model_dump_json()

    @server.resource(MISSIONS + "{mission_id}", mime_type="application/json")
    async def mission(mission_id: str) -> str:
        """Return the present state of a mission."""
        try:
            return session.status(mission_id).model_dump_json()
        except ValueError as error:
            raise ResourceNotFoundError(str(error)) from error


class _Updates:
    """Notices of changed resources, published at most once a second for each."""

    PERIOD_S = 1.0

    def __init__(self, bus: InMemorySubscriptionBus) -> None:
        self._bus = bus
        self._due: set[str] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    def changed(self, address: str) -> None:
        """Publish soon that the resource at `address` has changed."""
        if address in self._due:
            return
        self._due.add(address)
        task = asyncio.get_running_loop().create_task(self._publish(address))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _publish(self, address: str) -> None:
        await asyncio.sleep(self.PERIOD_S)
        self._due.discard(address)
        await self._bus.publish(ResourceUpdated(uri=address))


@contextmanager
def _refusal_as_error() -> Generator[None]:
    """Turn a refusal into an error for the agent; the library reports a defect as one."""
    try:
        yield
    except ValueError as error:
        raise ToolError(str(error)) from error


class AgentTokens:
    """A verifier that admits only tokens of the role proposer: an agent is not an operator."""

    def __init__(self, tokens: TokenBook) -> None:
        self._tokens = tokens

    async def verify_token(self, token: str) -> AccessToken | None:
        """Return the access of an agent's token; None if it is unknown or belongs to a person."""
        try:
            bearer = self._tokens.find(token)
        except (RefusedError, ValueError, OSError):
            return None
        if bearer is None or bearer.role != "proposer":
            return None
        return AccessToken(token=token, client_id=bearer.person, scopes=[SCOPE])


class AgentsPort:
    """A port for agents over HTTP beside a session, open as long as the session lasts.

    `take` must be called with every event of the session, in its event loop.
    """

    def __init__(
        self,
        session: AgentsSession,
        tokens: TokenBook,
        listening: Listening,
        failed: Callable[[Exception], None],
    ) -> None:
        """Call `failed` with a defect, and once if the system has no room for connections."""
        listening.failed = failed
        app = make_server(session, verifier=AgentTokens(tokens)).streamable_http_app(
            streamable_http_path=PATH, max_request_body_size=MOST_BYTES, max_sessions=MOST_SESSIONS
        )
        self._app, self._listening = Guard(app, listening, failed), listening
        self._session, self._failed = session, failed
        self._ended = asyncio.Event()
        self._work: asyncio.Task[None] | None = None

    def take(self, event: ev.Event) -> None:
        """Start to serve with the first event, and stop with the last."""
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
    """Serve one agent on stdin and stdout until it closes them."""
    await server.run_stdio_async()


async def bridge(url: str, token: str) -> None:
    """Carry messages between an agent on stdin and stdout and the server at `url`."""
    headers = {"Authorization": f"Bearer {token}"}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=None) as client,
        streamable_http_client(url, http_client=client) as (answers, requests),
        stdio_server() as (incoming, outgoing),
        asyncio.TaskGroup() as group,
    ):
        back = group.create_task(_carry(answers, outgoing))
        await _carry(incoming, requests)
        back.cancel()


async def _carry(source: Any, target: Any) -> None:
    """Carry messages until the source ends; values that are not messages are dropped."""
    with suppress(asyncio.CancelledError):
        async for message in source:
            if isinstance(message, SessionMessage):
                await target.send(message)
