"""The default model with its adapters, unscripted: plain orders are planned as they were meant."""

from collections.abc import AsyncGenerator

import pytest
import pytest_asyncio

from pa_console.llm.catalog import Catalog, find_model
from pa_console.llm.engine import Engine
from pa_console.llm.fetch import pull
from pa_console.orchestrator.clock import SteppedClock
from pa_console.orchestrator.compose import Site, open_station
from pa_console.orchestrator.headless import run_missions, standing_approver
from pa_console.schema.event import Event
from pa_console.session.fold import MissionTrace, SessionState


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def engine() -> AsyncGenerator[Engine]:
    pull(Catalog.load().get(Catalog.load().default))
    engine = Engine(find_model(None))
    yield engine
    await engine.close()


def unheard(_event: Event, _state: SessionState) -> None:
    """Take an event and do nothing."""


async def planned(engine: Engine, site: Site, text: str) -> MissionTrace:
    """Return the trace of the mission `text` at the checkpoint, approved by a standing order."""
    station = open_station(site, engine, SteppedClock(), respond=False)
    approver = standing_approver("auto", "it is a test")
    return (await run_missions(station, [text], approver, unheard))[0]


@pytest.mark.asyncio(loop_scope="module")
@pytest.mark.parametrize(
    ("text", "kinds", "place"),
    [
        ("One more drone to NorthGate, please.", {"Drone"}, "NorthGate"),
        ("Put a ground vehicle at the south gate.", {"Ugv"}, "SouthGate"),
    ],
)
async def test_an_order_to_a_place_sends_the_right_kind_there(
    engine: Engine, site: Site, text: str, kinds: set[str], place: str
) -> None:
    trace = await planned(engine, site, text)
    assert trace.status == "verified"
    plan = trace.attempts[-1].plan
    assert plan is not None
    assert {action.target for action in plan.actions} == {place}
    assert {action.agent.partition("_")[0] for action in plan.actions} == kinds


@pytest.mark.asyncio(loop_scope="module")
async def test_what_must_not_be_done_moves_nothing(engine: Engine, site: Site) -> None:
    trace = await planned(engine, site, "Have the drones follow the truck down the public road.")
    assert not any(
        action.verb not in ("hold", "report")
        for attempt in trace.attempts
        if attempt.plan is not None
        for action in attempt.plan.actions
    )
