"""Agents at the port of a console: who is let in, by what token, with what name."""

from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import httpx2
import pytest
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp.shared.subscriptions import ResourceUpdated

from pa_console.http.connections import listen
from pa_console.http.tokens import TokenBook, TokenRole
from pa_console.mcp.agents_session import AgentsSession
from pa_console.mcp.server import PATH, AgentsPort
from pa_console.schema.events import event as ev
from pa_console.station.assembly import Site
from tests.mcp.conftest import Beside, beside
from tests.mcp.test_server import TOOLS, called, refused


@asynccontextmanager
async def at_port(site: Site, tokens: TokenBook) -> AsyncGenerator[tuple[Beside, str]]:
    """Run a session whose agents come over HTTP; yield it and the address."""
    problems: list[Exception] = []
    with listen(0) as listening:
        address = f"http://127.0.0.1:{listening.getsockname()[1]}{PATH}"

        def admit(agents: AgentsSession) -> Callable[[ev.Event], None]:
            return AgentsPort(agents, tokens, listening, problems.append).take

        async with beside(site, admit=admit) as running:
            yield running, address
    assert not problems


@asynccontextmanager
async def client_with(address: str, token: str) -> AsyncGenerator[Client]:
    """Connect the official client with a token."""
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=30) as http,
        Client(streamable_http_client(address, http_client=http)) as client,
    ):
        yield client


@pytest.fixture
def tokens(tmp_path: Path) -> TokenBook:
    """The tokens of a machine."""
    return TokenBook(tmp_path / "tokens.json")


async def test_an_agent_is_known_by_its_token(site: Site, tokens: TokenBook) -> None:
    token = tokens.make("planner-7", "proposer")
    async with at_port(site, tokens) as (running, address), client_with(address, token) as client:
        assert {tool.name for tool in (await client.list_tools()).tools} == TOOLS
        given = await called(client, "propose_mission", text="Move Drone_T04 to the east gate.")
        request = await running.waiting(given["id"])
        assert request.proposed_by == "planner-7"
        running.approve(request)
        assert await running.ended(given["id"]) == "verified"
        assert (await called(client, "mission_status", mission_id=given["id"]))["status"]


async def test_an_update_of_the_picture_is_sent(site: Site, tokens: TokenBook) -> None:
    token = tokens.make("planner-7", "proposer")
    async with at_port(site, tokens) as (_, address), client_with(address, token) as client:
        async with client.listen(resource_subscriptions=["pa://picture"]) as updates:
            update = await anext(aiter(updates))
        assert update == ResourceUpdated(uri="pa://picture")


@pytest.mark.parametrize("role", [None, "observer", "operator", "commander"])
async def test_who_is_no_proposer_is_not_let_in(
    site: Site, tokens: TokenBook, role: TokenRole | None
) -> None:
    headers = {"Authorization": f"Bearer {tokens.make('ann', role)}"} if role else {}
    async with at_port(site, tokens) as (running, address):
        async with httpx2.AsyncClient(headers=headers) as http:
            said = await http.post(address, json={"jsonrpc": "2.0", "id": 1, "method": "ping"})
        assert said.status_code in (401, 403)
        assert not running.state.missions


async def test_a_revoked_token_is_refused_at_once(site: Site, tokens: TokenBook) -> None:
    token = tokens.make("planner-7", "proposer")
    async with at_port(site, tokens) as (running, address), client_with(address, token) as client:
        await called(client, "picture")
        tokens.revoke(tokens.listed()[0].id)
        with pytest.raises(Exception, match="error response"):
            await client.call_tool("propose_mission", {"text": "Move Drone_T04 to the east gate."})
        assert not running.state.missions


@pytest.mark.parametrize(
    "headers", [{"Host": "evil.example"}, {"Origin": "http://evil.example"}], ids=str
)
async def test_a_page_of_another_site_is_refused(
    site: Site, tokens: TokenBook, headers: dict[str, str]
) -> None:
    token = tokens.make("planner-7", "proposer")
    async with at_port(site, tokens) as (_, address), httpx2.AsyncClient() as http:
        given = {"Authorization": f"Bearer {token}", **headers}
        said = await http.post(address, json={}, headers=given)
        assert said.status_code in (403, 421)


async def test_a_body_that_is_too_long_is_refused(site: Site, tokens: TokenBook) -> None:
    token = tokens.make("planner-7", "proposer")
    async with at_port(site, tokens) as (_, address), httpx2.AsyncClient() as http:
        given = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
        said = await http.post(address, content=b"[" + b" " * 200_000, headers=given)
        assert said.status_code == 413


async def test_a_second_agent_cannot_withdraw_the_first_one_s(
    site: Site, tokens: TokenBook
) -> None:
    first, second = tokens.make("first", "proposer"), tokens.make("second", "proposer")
    async with (
        at_port(site, tokens) as (running, address),
        client_with(address, first) as one,
        client_with(address, second) as other,
    ):
        given = await called(one, "propose_mission", text="Move Drone_T04 to the east gate.")
        await running.waiting(given["id"])
        assert "not a proposal of second" in await refused(
            other, "withdraw", mission_id=given["id"]
        )
        assert running.state.missions[given["id"]].status is None
