"""The MCP server: its tools and resources, and where it is served, on a port or on stdio."""

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


class Meant(BaseModel):
    """What an unclear part of an order means."""

    answer: str = Field(description="one of the choices, or the name of an asset or a place")


def make_server(
    session: AgentsSession, agent: str = "", verifier: TokenVerifier | None = None
) -> MCPServer[Any]:
    """Return the server; its agent is `agent`, or by each request whom `verifier` lets in."""
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
        """The session as it stands: assets, tracks, gates, alarms, the queue, and the stop."""
        return session.picture()

    @server.tool(annotations=LOOKS)
    async def describe_asset(name: str) -> AssetView:
        """The latest report of an asset, and the commands that it may be given."""
        with _told():
            return session.describe_asset(name)

    @server.tool(annotations=LOOKS)
    async def rules(search: str = "", rule_id: str = "") -> FoundRules:
        """The rules in force: one by its id, the ten that fit a search best, or all."""
        with _told():
            return session.rules(search, rule_id)

    @server.tool(annotations=LOOKS)
    async def ask(text: Words) -> ev.QuestionAnswered:
        """Ask about the record, such as *Why?* or *Why is the north gate uncovered?*."""
        with _told():
            return await session.ask(text)

    @server.tool(annotations=LOOKS)
    async def check_plan(actions: Actions, purpose: Purpose = "") -> ExaminedPlan:
        """Check a plan against every rule in the present picture; nothing is queued."""
        with _told():
            return await session.examine(actions, purpose, rehearsed=False)

    @server.tool(annotations=LOOKS)
    async def rehearse_plan(actions: Actions, purpose: Purpose = "") -> ExaminedPlan:
        """Check a plan and tell how its rehearsal goes, gate by gate; nothing is queued."""
        with _told():
            return await session.examine(actions, purpose, rehearsed=True)

    @server.tool(annotations=LOOKS)
    async def mission_status(mission_id: str) -> MissionDetail:
        """A mission with its plans, the findings on them, who decided what, and its outcome."""
        with _told():
            return session.status(mission_id)


def _add_proposing(server: MCPServer[Any], session: AgentsSession, who: Callable[[], str]) -> None:
    """Add the tools that propose, take back and stop."""

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
        """Propose a mission in plain words; a person decides about the plan made for it.

        Name assets and places: what others ordered before is not known to your words.
        """
        with _told():
            return session.propose(who(), _clear(session, text, meant))

    @server.tool(annotations=PROPOSES)
    async def propose_plan(
        purpose: Words,
        actions: Actions,
        reason: Annotated[str, Field(max_length=MAX_REASON // 2)] = "",
    ) -> MissionView:
        """Propose a plan of your own for a purpose; it is checked, judged, and decided about."""
        with _told():
            return session.propose(who(), purpose, actions, reason)

    @server.tool(annotations=WITHDRAWS)
    async def withdraw(mission_id: str) -> str:
        """Take back a proposal of yours that nobody has approved yet."""
        with _told():
            session.withdraw(who(), mission_id)
        return f"{mission_id} is withdrawn"

    @server.tool(annotations=STOPS)
    async def stop() -> str:
        """STOP: every asset holds at once, and every mission ends; only a person releases it."""
        with _told():
            session.stop(who())
        return "every asset was told to hold; mission_status and picture show what telemetry says"


def _clear(session: AgentsSession, text: str, meant: ElicitationResult[Meant]) -> str:
    """Return the words with the answer in place of what was unclear; raises ValueError without."""
    unclear = session.unclear(text)
    if unclear is None:
        return text
    answer = meant.data.answer.strip() if isinstance(meant, AcceptedElicitation) else ""
    if not answer:
        choices = f"; it may mean {', '.join(unclear.choices)}" if unclear.choices else ""
        raise ValueError(f"not proposed: {unclear.question}{choices}")
    if unclear.said and unclear.said in text:
        return text.replace(unclear.said, answer, 1)
    return f"{text} ({answer})"


def _add_resources(server: MCPServer[Any], session: AgentsSession) -> None:
    """Add what can be read, and followed, under an address."""

    @server.resource(PICTURE, mime_type="application/json")
    async def picture_now() -> str:
        """The session as it stands."""
        return session.picture().model_dump_json()

    @server.resource(RULES, mime_type="application/json")
    async def rules_in_force() -> str:
        """Every rule in force."""
        return session.rules().model_dump_json()

    @server.resource(MISSIONS + "{mission_id}", mime_type="application/json")
    async def mission(mission_id: str) -> str:
        """A mission as it stands."""
        try:
            return session.status(mission_id).model_dump_json()
        except ValueError as error:
            raise ResourceNotFoundError(str(error)) from error


class _Updates:
    """Publishes which resources have changed, each at most once a second."""

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
def _told() -> Generator[None]:
    """Tell an agent why something was not done; a defect is told as one by the library."""
    try:
        yield
    except ValueError as error:
        raise ToolError(str(error)) from error


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
            streamable_http_path=PATH, max_request_body_size=MOST_BYTES, max_sessions=MOST_SESSIONS
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
