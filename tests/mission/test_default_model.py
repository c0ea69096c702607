"""The default model with its adapters, unscripted: plain orders are planned as they were meant."""

from collections.abc import AsyncGenerator
from datetime import UTC, datetime

import pytest
import pytest_asyncio

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.canonical.reading import asked_words, read_asked
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import Catalog, find_model
from pa_console.llm.models.fetching import pull
from pa_console.llm.roles.planner import Planner
from pa_console.llm.roles.role_model import PROMPT_FORMATS
from pa_console.mission.approval import standing_approver
from pa_console.mission.context import Services
from pa_console.mission.planning.propose import ask_for_plan
from pa_console.mission.retrieve import RetrievedRules
from pa_console.schema.events.event import Event
from pa_console.schema.mission import Mission
from pa_console.session.state import MissionTrace, SessionState
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions

# A busy machine takes minutes to load the model and to answer.
pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]


@pytest.fixture
def site() -> Site:
    """Return the checkpoint; its rule checks get time enough beside a model that computes."""
    return load_site("checkpoint", "checkpoint", deadline_s=60.0)


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
    station = open_station(site, engine, SteppedClock(), keep_engine=True)
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


@pytest.mark.asyncio(loop_scope="module")
async def test_what_else_an_order_may_mean_can_be_read_and_planned_for(
    engine: Engine, site: Site
) -> None:
    await engine.start()
    planner = Planner(engine, deadline_s=300.0)
    fleet = SimulatedFleet.start(site.world)
    services = Services.open(fleet, site.rulebook, engine, prompt_format=PROMPT_FORMATS["compact"])
    text = "Drone_T02 should go home unless NorthGate is empty"
    task = Mission(id="M1", text=text, created=datetime(2026, 1, 1, tzinfo=UTC))
    question = ask_for_plan(services, RetrievedRules(task, ()))
    found, usage = await planner.readings(question.prompt, question.reasons, 4)
    assert found
    assert len(set(found)) == len(found)
    for asked in found:
        reading = read_asked(asked)
        assert reading is not None
        assert reading.readable
    assert usage.completion_tokens > 0
    again = ask_for_plan(services, RetrievedRules(task, (), chosen=found[-1]))
    proposal = await planner.plan(again.prompt, again.grammar)
    assert proposal.plan is not None
    assert asked_words(proposal.plan.reason).rstrip("; ") == found[-1]
