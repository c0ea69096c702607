"""The server as its clients see it, in one process."""

from typing import Any

import pytest
from mcp import Client

from pa_console.mcp.server import make_server
from pa_console.schema.events import event as ev
from pa_console.station.assembly import Site
from tests.mcp.conftest import beside

UNCLEAR = "Send the other drone to EastGate."
EAST = [{"agent": "Drone_T04", "command": "move_to EastGate"}]
READS = {"picture", "describe_asset", "rules", "ask", "check_plan", "rehearse_plan"}
TOOLS = READS | {"mission_status", "propose_mission", "propose_plan", "withdraw", "stop"}


async def called(client: Client, tool: str, /, **given: Any) -> Any:
    """Call a tool and return what it gives; fails the test on an error."""
    result = await client.call_tool(tool, given)
    assert not result.is_error, result.content
    return result.structured_content


async def refused(client: Client, tool: str, /, **given: Any) -> str:
    """Call a tool that must not do it, and return why."""
    result = await client.call_tool(tool, given)
    assert result.is_error
    return str(result.content[0])


async def test_there_are_these_tools_and_none_that_decides(site: Site) -> None:
    async with beside(site) as running, Client(make_server(running.agents, "planner-7")) as client:
        tools = {tool.name: tool for tool in (await client.list_tools()).tools}
    assert set(tools) == TOOLS
    hints = {name: tool.annotations for name, tool in tools.items()}
    assert {name for name, hint in hints.items() if hint and hint.read_only_hint} == READS | {
        "mission_status"
    }
    assert [name for name, hint in hints.items() if hint and hint.destructive_hint] == ["stop"]


async def test_an_agent_looks_asks_and_examines(site: Site) -> None:
    async with beside(site) as running, Client(make_server(running.agents, "planner-7")) as client:
        picture = await called(client, "picture")
        assert set(picture["picture"]["assets"]) == set(site.world.assets)
        drone = await called(client, "describe_asset", name="Drone_T04")
        assert "observe" in drone["commands"]
        assert "block" not in drone["commands"]
        assert "known: Drone_T01" in await refused(client, "describe_asset", name="Drone_T99")
        (rule,) = (await called(client, "rules", rule_id="ROE-01"))["rules"]
        assert "lethal" in rule["text"]
        found = (await called(client, "rules", search="unknown vehicle"))["rules"]
        assert 0 < len(found) <= 10
        answer = await called(client, "ask", text="Why is nobody at the north gate?")
        assert answer["lines"]
        assert "question" in await refused(client, "ask", text="Send a drone.")
        checked = await called(client, "check_plan", actions=EAST)
        assert (checked["blocked"], checked["rehearsal"]) == (False, None)
        stripped = [{"agent": "Drone_T01", "command": "return_to_base"}]
        rehearsed = await called(client, "rehearse_plan", actions=stripped)
        assert rehearsed["rehearsal"]["gates"]["WestGate"]["covered_after"] is False
        assert not running.state.missions


async def test_a_plan_in_steps_is_examined_and_what_is_none_is_told_in_one_line(
    site: Site,
) -> None:
    first = {"agent": "Robot_T01", "command": "move_to NorthGate"}
    home = {"agent": "Ugv_T02", "command": "return_to_base"}
    async with beside(site) as running, Client(make_server(running.agents, "p")) as client:
        checked = await called(client, "check_plan", actions=[first, {**home, "after": [1]}])
        assert not checked["blocked"]
        circle = [{**first, "after": [2]}, {**home, "after": [1]}]
        told = await refused(client, "check_plan", actions=circle)
        assert "wait for each other in a circle" in told
        assert "\n" not in told


async def test_a_proposal_is_approved_by_a_person_and_the_agent_reads_its_outcome(
    site: Site,
) -> None:
    async with beside(site) as running, Client(make_server(running.agents, "planner-7")) as client:
        given = await called(client, "propose_mission", text="Move Drone_T04 to the east gate.")
        assert given["source"] == "agent"
        request = await running.waiting(given["id"])
        assert request.proposed_by == "planner-7"
        assert not running.sent
        running.approve(request)
        assert await running.ended(given["id"]) == "verified"
        status = await called(client, "mission_status", mission_id=given["id"])
        assert status["status"] == "verified"
        assert "Proposed by agent planner-7 over MCP" in status["report"]
        assert [one["decision"]["by"] for one in status["decisions"]] == ["operator"]


async def test_a_plan_of_the_agent_s_own_is_what_the_person_decides_about(site: Site) -> None:
    robot = [{"agent": "Robot_T01", "command": "move_to EastGate"}]
    async with beside(site) as running, Client(make_server(running.agents, "planner-7")) as client:
        given = await called(
            client, "propose_plan", purpose="Robot_T01 to the east gate", actions=robot
        )
        request = await running.waiting(given["id"])
        assert [(a.agent, a.command) for a in request.plan.actions] == [
            ("Robot_T01", "move_to EastGate")
        ]
        assert request.plan.reason.startswith("agent planner-7: ")
        assert [one.author for one in running.state.missions[given["id"]].attempts] == ["agent"]
        running.approve(request)
        await running.ended(given["id"])
        assert {sent.command.agent for sent in running.sent} == {"Robot_T01"}


async def test_resources_are_read(site: Site) -> None:
    async with beside(site) as running, Client(make_server(running.agents, "planner-7")) as client:
        read = await client.read_resource("pa://picture")
        assert "Drone_T04" in str(read.contents[0])
        read = await client.read_resource("pa://rules")
        assert "ROE-01" in str(read.contents[0])
        given = await called(client, "propose_mission", text="Move Drone_T04 to the east gate.")
        read = await client.read_resource(f"pa://missions/{given['id']}")
        assert given["id"] in str(read.contents[0])
        with pytest.raises(Exception, match="M999"):
            await client.read_resource("pa://missions/M999")


async def test_what_is_unclear_is_not_proposed_where_nobody_can_be_asked(site: Site) -> None:
    async with beside(site) as running, Client(make_server(running.agents, "a")) as unable:
        assert "not proposed" in await refused(unable, "propose_mission", text=UNCLEAR)
        assert not running.state.missions


async def test_a_proposal_is_taken_back(site: Site) -> None:
    async with beside(site) as running, Client(make_server(running.agents, "planner-7")) as client:
        given = await called(client, "propose_mission", text="Move Drone_T04 to the east gate.")
        await running.waiting(given["id"])
        await called(client, "withdraw", mission_id=given["id"])
        assert await running.ended(given["id"]) == "cancelled"
        assert running.state.missions[given["id"]].reason == "withdrawn by agent planner-7"
        assert not running.sent


async def test_an_agent_stops_everything_and_cannot_release(site: Site) -> None:
    async with beside(site) as running, Client(make_server(running.agents, "planner-7")) as client:
        await called(client, "stop")
        await running.until(lambda: running.state.stop is not None)
        assert {sent.command.verb for sent in running.sent} == {"hold"}
        stops = [e.data.by for e in running.events if isinstance(e.data, ev.AllStopped)]
        assert stops == ["agent planner-7"]
        said = await refused(client, "propose_mission", text="Move Drone_T04 to the east gate.")
        assert "released" in said
        assert "release" not in {tool.name for tool in (await client.list_tools()).tools}
