"""A model that was not trained for orders says what one asks; the console makes the plan of it."""

import json
import math
from dataclasses import replace
from datetime import UTC, datetime

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.canonical.reading import asked_words, read_reason
from pa_console.llm.roles.clause_reader import reading_prompt
from pa_console.mission.planning.picture_text import digest_picture
from pa_console.mission.planning.propose import served_plan, still
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.sim.checkpoint import Checkpoint
from tests.mission.test_rereading import EAST, NORTH
from tests.mission.test_rereading import engine as compact_engine
from tests.rig import Rig
from tests.scripted import ScriptedEngine

NO_TIME = datetime(2026, 1, 1, tzinfo=UTC)


def says(*asked: str, sure: float = 0.9) -> ScriptedEngine:
    """Return a model that reads orders as each of `asked`, in turn."""
    answers = [json.dumps({"reason": words}) for words in asked]
    chances = [(answers[0].index("asked: ") + len("asked: "), math.log(sure))]
    scripted = ScriptedEngine(answers, chances=chances)
    scripted.model = replace(scripted.model, prompts="clauses")
    return scripted


def proposals(rig: Rig) -> list[ev.PlanProposed]:
    return [event.data for event in rig.events if isinstance(event.data, ev.PlanProposed)]


async def test_what_is_asked_is_planned_and_done(rig: Rig) -> None:
    scripted = says(EAST)
    trace = await rig.run(scripted)
    assert trace.status == "verified"
    assert rig.state.picture is not None
    assert rig.state.picture.assets["Drone_T04"].at == "EastGate"
    [proposed] = proposals(rig)
    assert proposed.plan is not None
    assert proposed.plan.reason == f"{EAST}; Drone_T04: free"
    assert proposed.confidence == 0.9
    [request] = [request for request in scripted.requests if request.role == "planner"]
    assert "EastGate" in request.grammar
    assert "move_to" not in request.grammar, "no command is asked for"


async def test_a_plan_that_is_blocked_does_not_change_what_was_asked(rig: Rig) -> None:
    scripted = says("asked: Drone_T01 home; others stay", EAST)
    await rig.run(scripted)
    assert len([request for request in scripted.requests if request.role == "planner"]) == 1
    assert all(p.plan and "Drone_T01 home" in p.plan.reason for p in proposals(rig))


async def test_what_nobody_may_do_is_not_done(rig: Rig) -> None:
    await rig.run(says("asked: use force at EastGate"))
    [proposed] = proposals(rig)
    assert proposed.plan is not None
    assert {action.verb for action in proposed.plan.actions} <= {"hold"}


async def test_an_answer_in_other_words_is_no_plan(rig: Rig) -> None:
    trace = await rig.run(says("asked: a drone to the moon"))
    assert trace.status == "held"
    assert all(proposed.plan is None for proposed in proposals(rig))


async def test_a_second_reader_that_was_not_trained_only_offers_what_it_reads(rig: Rig) -> None:
    scripted = compact_engine([EAST], [EAST], sure=0.7)
    scripted.second_reader = ScriptedEngine([], [json.dumps({"reason": NORTH})])
    await rig.run(scripted)
    [request] = [e.data for e in rig.events if isinstance(e.data, ev.ApprovalRequested)]
    assert (request.asked, request.plan.actions[0].command) == (EAST, "move_to EastGate")
    assert NORTH in request.readings


def test_the_reason_of_two_clauses_keeps_both(rig: Rig) -> None:
    world = rig.site.world
    picture = SimulatedFleet(Checkpoint(world, 0)).picture()
    asked = "asked: 1 drone to EastGate; report"
    made = served_plan(asked, still(picture), digest_picture(picture, world))
    assert asked_words(made.reason).rstrip("; ") == asked
    reading = read_reason(made.reason)
    assert reading is not None
    assert [ask.task for ask in reading.asks] == ["go", "report"]
    assert Plan.model_validate_json(made.answer) == made


def test_names_and_orders_like_it_are_in_the_prompt_and_no_rule(rig: Rig) -> None:
    world = rig.site.world
    digest = digest_picture(SimulatedFleet(Checkpoint(world, 0)).picture(), world)
    order = Mission(id="M", text="Send a UAV to the east gate.", created=NO_TIME)
    prompt = reading_prompt(world, digest, (), order)
    assert set(world.gates) <= set(prompt.user.replace(",", " ").split())
    assert prompt.user.endswith('Mission: "Send a UAV to EastGate."')
    assert prompt.user.count('{"reason": "asked: ') == 8


@pytest.mark.parametrize(
    ("asked", "commands"),
    [
        ("Drone_T04 identify vehicle at EastGate", {"Drone_T04 observe EastGate"}),
        ("Drone_T04 warn vehicle at EastGate", {"Drone_T04 observe EastGate"}),
        ("Robot_T01 look at EastGate", {"Robot_T01 move_to EastGate"}),
        ("Drone_T04 block EastGate", {"Ugv_T01 block EastGate"}),
        ("Drone_T04 block EastGate; others stay", {"Drone_T01 hold"}),
    ],
)
async def test_who_cannot_do_it_does_what_it_can_and_another_one_the_rest(
    rig: Rig, asked: str, commands: set[str]
) -> None:
    await rig.run(says(f"asked: {asked}"))
    proposed = proposals(rig)[-1]
    assert proposed.plan is not None
    assert {f"{a.agent} {a.command}" for a in proposed.plan.actions} >= commands
    request = next(e.data for e in rig.events if isinstance(e.data, ev.ApprovalRequested))
    assert request.state != "approve", "what was told is not done as it was told"


async def test_a_plan_that_does_nothing_of_what_was_asked_is_not_verified(rig: Rig) -> None:
    trace = await rig.run(says("asked: Drone_T04 block EastGate; others stay"))
    assert trace.status == "held"
    assert "nothing was done: Drone_T04 block EastGate: no drone can block" in trace.reason


async def test_the_place_of_an_order_that_names_none_of_the_site_is_asked_for(rig: Rig) -> None:
    await rig.run(says("asked: Robot_T01 to unknown place"))
    asked = next(e.data for e in rig.events if isinstance(e.data, ev.QuestionAsked))
    assert "Robot_T01 to SouthGate" in asked.choices
    assert not any(isinstance(e.data, ev.CommandSent) for e in rig.events)


async def test_no_choice_of_a_place_names_an_asset_that_does_not_exist(rig: Rig) -> None:
    await rig.run(says("asked: Robot_T09 to unknown place"))
    asked = next(e.data for e in rig.events if isinstance(e.data, ev.QuestionAsked))
    assert asked.choices == ()
    assert not any(isinstance(e.data, ev.CommandSent) for e in rig.events)
