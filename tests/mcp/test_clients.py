"""The official client, in its present and its older protocol, and fastmcp's: stdio and HTTP."""

import asyncio
import os
import signal
import sys
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import fastmcp
import httpx2
import pytest
from fastmcp.client.transports import StdioTransport, StreamableHttpTransport
from mcp import Client, StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client
from mcp.server.subscriptions import ResourceUpdated
from mcp_types import ElicitResult

from pa_console.http.tokens import TokenBook
from pa_console.mcp.server import make_server
from pa_console.station.assembly import Site
from tests.mcp.conftest import Beside, beside
from tests.mcp.test_over_http import at_port
from tests.mcp.test_server import TOOLS, UNCLEAR

Call = Callable[..., Awaitable[Any]]
"""Calls a tool by name, and returns what it gives."""
REPO = Path(__file__).parents[2]
KINDS = ("official", "older", "fastmcp")
STILL = [{"agent": "Drone_T04", "command": "hold"}]


def call_with(client: Any) -> Call:
    """Return what calls tools with a client of either library."""

    async def call(tool: str, /, **given: Any) -> Any:
        result = await client.call_tool(tool, given)
        assert not result.is_error, result.content
        return result.structured_content

    return call


@asynccontextmanager
async def over_http(kind: str, address: str, token: str, **more: Any) -> AsyncGenerator[Any]:
    """Connect a client of a kind to a port."""
    headers = {"Authorization": f"Bearer {token}"}
    if kind == "fastmcp":
        async with fastmcp.Client(StreamableHttpTransport(address, headers=headers)) as client:
            yield client
        return
    mode = "legacy" if kind == "older" else "auto"
    async with (
        httpx2.AsyncClient(headers=headers, timeout=30) as http,
        Client(streamable_http_client(address, http_client=http), mode=mode, **more) as client,
    ):
        yield client


def over_stdio(kind: str, pid_file: Path) -> AbstractAsyncContextManager[Any]:
    """Start a console in a process of its own, and connect a client of a kind to it."""
    python = [*sys.orig_argv[:1], "-m", "tests.mcp.scripted_console", str(pid_file)]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    if kind == "fastmcp":
        return fastmcp.Client(StdioTransport(sys.executable, python[1:], env=env, cwd=str(REPO)))
    started = StdioServerParameters(command=sys.executable, args=python[1:], env=env, cwd=REPO)
    return Client(stdio_client(started), mode="legacy" if kind == "older" else "auto")


async def uses_everything(call: Call, approve: Callable[[str], Awaitable[object]]) -> None:
    """Use every tool as an agent does that has a proposal approved by `approve`."""
    assert (await call("picture"))["picture"]["assets"]
    assert "observe" in (await call("describe_asset", name="Drone_T04"))["commands"]
    assert (await call("rules", rule_id="ROE-01"))["rules"]
    assert (await call("ask", text="Why?"))["lines"] is not None
    assert not (await call("check_plan", actions=STILL))["blocked"]
    assert (await call("rehearse_plan", actions=STILL))["rehearsal"]
    given = await call("propose_plan", purpose="Drone_T04 holds.", actions=STILL, reason="calm")
    await approve(given["id"])
    while (status := await call("mission_status", mission_id=given["id"]))["status"] is None:
        pass
    assert status["status"] == "verified"
    assert "Proposed by agent planner-7 over MCP" in status["report"]
    other = await call("propose_mission", text="Move Drone_T04 to EastGate.")
    assert other["source"] == "agent"
    await call("stop")
    while (status := await call("mission_status", mission_id=other["id"]))["status"] is None:
        pass
    assert status["status"] == "cancelled"


@pytest.mark.parametrize("kind", KINDS)
async def test_an_agent_at_a_port_uses_every_tool(site: Site, tmp_path: Path, kind: str) -> None:
    tokens = TokenBook(tmp_path / "tokens.json")
    token = tokens.make("planner-7", "proposer")
    async with at_port(site, tokens) as (running, address), over_http(kind, address, token) as one:
        assert {tool.name for tool in await _tools(one)} == TOOLS

        async def approve(mission: str) -> None:
            running.approve(await running.waiting(mission))

        await uses_everything(call_with(one), approve)
        assert {sent.command.verb for sent in running.sent} == {"hold"}


@pytest.mark.parametrize("kind", KINDS)
async def test_an_agent_on_stdio_uses_every_tool_and_is_told_when_the_server_dies(
    tmp_path: Path, kind: str
) -> None:
    pid_file, told = tmp_path / "pid", ""
    async with over_stdio(kind, pid_file) as client:
        assert {tool.name for tool in await _tools(client)} == TOOLS

        async def approve(_: str) -> None:
            """Leave it to the operator of that process."""

        await uses_everything(call_with(client), approve)
        os.kill(int(pid_file.read_text("utf-8")), signal.SIGKILL)
        async with asyncio.timeout(60):
            try:
                await client.call_tool("picture", {})
            except TimeoutError:
                raise
            except Exception as error:
                told = repr(error)
    assert told


async def _tools(client: Any) -> Any:
    listed = await client.list_tools()
    return getattr(listed, "tools", listed)


@pytest.mark.parametrize("kind", KINDS)
async def test_a_call_that_is_cancelled_proposes_nothing(site: Site, kind: str) -> None:
    asked = asyncio.Event()

    async def never(*_: Any) -> ElicitResult:
        asked.set()
        await asyncio.Event().wait()
        raise AssertionError

    async with beside(site) as running:
        async with _in_process(kind, running, never) as client:
            call = asyncio.create_task(client.call_tool("propose_mission", {"text": UNCLEAR}))
            await asked.wait()
            call.cancel()
            await asyncio.gather(call, return_exceptions=True)
            assert (await call_with(client)("picture"))["picture"]
        assert not running.state.missions


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("answer", ["Drone_T04", ""])
async def test_what_is_unclear_is_asked_back(site: Site, kind: str, answer: str) -> None:
    async def answered(*_: Any) -> ElicitResult:
        if not answer:
            return ElicitResult(action="decline")
        return ElicitResult(action="accept", content={"answer": answer})

    async with beside(site) as running, _in_process(kind, running, answered) as client:
        if answer:
            given = await call_with(client)("propose_mission", text=UNCLEAR)
            assert answer in given["text"]
            assert (await running.waiting(given["id"])).proposed_by == "planner-7"
            assert not running.sent
        else:
            with pytest.raises(Exception, match="not proposed"):
                await call_with(client)("propose_mission", text=UNCLEAR)
            assert not running.state.missions


def _in_process(
    kind: str, running: Beside, answered: Callable[..., Any]
) -> AbstractAsyncContextManager[Any]:
    server = make_server(running.agents, "planner-7")
    if kind == "fastmcp":
        return fastmcp.Client(server, elicitation_handler=answered)
    mode = "legacy" if kind == "older" else "auto"
    return Client(server, mode=mode, elicitation_callback=answered)


async def test_news_of_a_mission_is_sent_as_it_goes_on(site: Site) -> None:
    async with beside(site) as running, Client(make_server(running.agents, "a")) as client:
        given = await call_with(client)("propose_plan", purpose="Drone_T04 holds.", actions=STILL)
        address = f"pa://missions/{given['id']}"
        async with client.listen(resource_subscriptions=[address]) as updates:
            running.approve(await running.waiting(given["id"]))
            status = ""
            while '"status":"verified"' not in status:
                assert await anext(aiter(updates)) == ResourceUpdated(uri=address)
                status = str((await client.read_resource(address)).contents[0])
