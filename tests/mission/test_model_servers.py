"""A model on a server plans and judges; when it fails the own one does, and that is all."""

import json
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from unittest.mock import AsyncMock

import pytest

from pa_console.llm.remote.address import ServerAddress, ServerKey
from pa_console.llm.remote.client import ServerClient
from pa_console.llm.remote.engine import ServerEngine
from pa_console.llm.remote.servers import Servers
from pa_console.mission.approval import standing_approver
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.session.confidence import Evidence, calibrated_confidence
from pa_console.session.mission_trace import MissionTrace
from pa_console.station.assembly import open_station
from pa_console.station.clock import SteppedClock
from tests.llm.servers.fault_proxy import FaultProxy
from tests.mission.test_rereading import EAST, NORTH
from tests.mission.test_rereading import engine as compact_engine
from tests.rig import Rig
from tests.scripted import SUCCESS, ScriptedEngine, plan

TEXT = "Drone_T04, fly to NorthGate."
PLAN = plan(("Drone_T04", "move_to NorthGate"))
OWN = plan(("Drone_T04", "move_to NorthGate"), reason="by the own model")


@asynccontextmanager
async def server_engine(
    proxy: FaultProxy, patience_s: float = 20.0
) -> AsyncGenerator[ServerEngine]:
    async with proxy.running():
        address = ServerAddress.parse(proxy.address)
        yield ServerEngine(address, ServerKey(), patience_s=patience_s)


async def flown(
    rig: Rig, engine: ScriptedEngine, servers: Servers, text: str = TEXT
) -> MissionTrace:
    """One mission, approved by a person whatever the doubts; its events are those of `rig`."""
    station = open_station(rig.site, engine.engine(), SteppedClock(), servers=servers)

    def approve(request: ev.ApprovalRequested) -> Decision:
        return Decision(kind="approve", by="person", acknowledged=request.acknowledge)

    return (await rig.carry_out(station, [text], approve))[0]


def told(rig: Rig) -> list[str]:
    """What the log says of the own model taking over."""
    notices = (event.data for event in rig.events if isinstance(event.data, ev.Noticed))
    return [notice.text for notice in notices if notice.subject == "model server"]


def asked(rig: Rig) -> list[tuple[str, bool]]:
    """Who was asked for what: the role, and whether on a server."""
    prompts = (event.data for event in rig.events if isinstance(event.data, ev.PromptBuilt))
    return [(prompt.role, bool(prompt.server)) for prompt in prompts]


async def test_a_server_plans_and_another_one_judges(rig: Rig) -> None:
    planner, judge = FaultProxy(), FaultProxy(holds=("guided_json",))
    planner.answers = [PLAN]
    engine = ScriptedEngine([None])
    async with server_engine(planner) as plans, server_engine(judge) as judges:
        trace = await flown(rig, engine, Servers({"planner": plans, "judge": judges}))
    assert trace.status == "verified"
    assert asked(rig)[:2] == [("planner", True), ("judge", True)]
    assert engine.requests == []
    assert told(rig) == []
    states = {event.data.state for event in rig.events if isinstance(event.data, ev.ServerChanged)}
    assert states == {"probing", "ready"}
    started = rig.events[0].data
    assert isinstance(started, ev.SessionStarted)
    assert started.servers == {"planner": planner.address, "judge": judge.address}


@pytest.mark.parametrize("fault", ["hang", "cut", "401", "redirect"])
async def test_a_server_that_fails_in_a_mission_is_not_noticed_by_it(rig: Rig, fault: str) -> None:
    proxy = FaultProxy()
    async with server_engine(proxy, 0.3 if fault == "hang" else 20.0) as server:
        await server.look()
        proxy.faults = [fault]  # type: ignore[list-item]
        server.start = AsyncMock()  # it was looked at
        trace = await flown(rig, ScriptedEngine([OWN]), Servers({"planner": server}))
    assert trace.status == "verified"
    assert len(trace.attempts) == 1
    assert trace.attempts[0].text == OWN
    assert asked(rig)[:2] == [("planner", True), ("planner", False)]
    assert len(told(rig)) == 1
    assert "on this machine answers" in told(rig)[0]


async def test_a_server_that_is_gone_is_not_asked(rig: Rig) -> None:
    proxy = FaultProxy()
    async with proxy.running():
        address = ServerAddress.parse(proxy.address)
    client = ServerClient(address, ServerKey(), retries=0)
    server = ServerEngine(address, ServerKey(), client=client)
    await server.look()
    trace = await flown(rig, ScriptedEngine([OWN]), Servers({"planner": server}))
    assert trace.status == "verified"
    assert asked(rig)[0] == ("planner", False)
    assert told(rig) == []


async def test_a_judge_on_a_server_that_says_nothing_is_replaced(rig: Rig) -> None:
    proxy = FaultProxy()
    async with server_engine(proxy) as server:
        await server.look()
        proxy.faults = ["wrong form", "wrong form"]
        server.start = AsyncMock()  # it was looked at
        engine = ScriptedEngine([OWN], [SUCCESS])
        trace = await flown(rig, engine, Servers({"judge": server}))
    assert trace.status == "verified"
    assert len(told(rig)) >= 1
    verdicts = [event.data for event in rig.events if isinstance(event.data, ev.PlanJudged)]
    assert [one.verdict is not None for one in verdicts] == [True]


async def test_a_plan_whose_model_tells_no_chance_is_never_plainly_approved(rig: Rig) -> None:
    proxy = FaultProxy(chances=False)
    proxy.answers = [PLAN]
    async with server_engine(proxy) as server:
        await flown(rig, ScriptedEngine([None], [SUCCESS]), Servers({"planner": server}))
    request = next(e.data for e in rig.events if isinstance(e.data, ev.ApprovalRequested))
    assert request.state == "may_be_misunderstood"
    assert any("not known" in gap for gap in request.gaps)
    decision = standing_approver("auto", least=0.7)(request)
    assert decision.kind == "reject"


async def test_an_objection_is_no_failure_of_the_server(rig: Rig) -> None:
    proxy = FaultProxy(choice=-1)
    async with server_engine(proxy) as server:
        await flown(rig, ScriptedEngine([OWN]), Servers({"judge": server}))
    verdict = next(e.data for e in rig.events if isinstance(e.data, ev.PlanJudged)).verdict
    assert verdict is not None
    assert verdict.verdict == "Failure"
    assert told(rig) == []


async def read_again(rig: Rig, said: str, sure: float) -> ev.ApprovalRequested:
    """The request for an order that was read as EAST, where a second reader on a server says so."""
    proxy = FaultProxy()
    proxy.answers = [json.dumps({"reason": said})]
    scripted = compact_engine([EAST], [EAST], sure=sure)
    scripted.second_reader = compact_engine([EAST], [EAST], sure=0.99)
    async with server_engine(proxy) as server:
        servers = Servers({"second reader": server})
        await flown(rig, scripted, servers, "Send a drone to EastGate.")
    assert scripted.second_reader.requests == []
    return next(e.data for e in rig.events if isinstance(e.data, ev.ApprovalRequested))


async def test_a_second_reader_on_a_server_offers_its_reading_and_decides_nothing(rig: Rig) -> None:
    request = await read_again(rig, "1 drone to NorthGate", 0.7)
    assert request.asked == EAST
    assert NORTH in request.readings
    assert request.state == "may_be_misunderstood"


async def test_a_second_reader_on_a_server_takes_no_doubt_away(rig: Rig) -> None:
    request = await read_again(rig, "1 drone to EastGate", 0.4)
    assert request.confidence == pytest.approx(calibrated_confidence(Evidence(0.4, 0.4)), abs=0.001)
    assert request.state == "may_be_misunderstood"


async def test_what_is_no_canonical_clause_is_no_reading(rig: Rig) -> None:
    request = await read_again(rig, "1 drone to the Moon", 0.7)
    assert request.plan.actions[0].command == "move_to EastGate"
    [read] = [event.data for event in rig.events if isinstance(event.data, ev.OrderReadAgain)]
    assert (read.asked, "no reading" in read.error) == ("", True)
