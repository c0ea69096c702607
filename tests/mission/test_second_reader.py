"""Where planner or judge is unsure of an order, another model reads it again."""

import math
from dataclasses import replace

import pytest

from pa_console.llm.backend import EngineDiedError
from pa_console.mission import readings as second_reader
from pa_console.schema.events import event as ev
from pa_console.session.confidence import UNSURE
from tests.mission.test_rereading import (
    EAST,
    NORTH,
    answer,
    choosing,
    engine,
    requests,
    verdicts,
)
from tests.rig import Rig
from tests.scripted import Answer, ScriptedEngine, plan

TO_EAST = "Send a drone to EastGate."
TO_NORTH = "Send a drone to NorthGate."


def reader(asked: Answer, sure: float) -> ScriptedEngine:
    """Return a trained second reader that says that so much was `asked`, and how sure it is."""
    said = verdicts(asked)[0] if isinstance(asked, str) else asked
    scripted = ScriptedEngine([], [said], chances=[(0, math.log(sure))])
    scripted.model = replace(scripted.model, prompts="compact")
    return scripted


def read_again(rig: Rig) -> list[ev.OrderReadAgain]:
    return [e.data for e in rig.events if isinstance(e.data, ev.OrderReadAgain)]


async def test_a_clear_order_is_read_once(rig: Rig) -> None:
    scripted = engine([EAST], [EAST], sure=0.9)
    scripted.second_reader = reader(NORTH, 0.99)
    await rig.run(scripted, text=TO_EAST)
    assert read_again(rig) == []
    assert scripted.second_reader.requests == []


async def test_a_second_reader_that_says_the_same_takes_the_doubt_away(rig: Rig) -> None:
    scripted = engine([EAST], [EAST], sure=0.4)
    scripted.second_reader = reader(EAST, 0.9)
    await rig.run(scripted, text=TO_EAST)
    [request], [read] = requests(rig), read_again(rig)
    assert (read.asked, read.confidence) == (EAST, 0.9)
    assert request.plan.actions[0].command == "move_to EastGate"
    assert request.confidence is not None
    assert request.confidence >= UNSURE
    assert request.state == "approve"


async def test_what_a_second_reader_says_is_served_and_the_first_reading_offered(
    rig: Rig,
) -> None:
    scripted = engine([EAST, NORTH], [EAST, NORTH], sure=0.4)
    scripted.second_reader = reader(NORTH, 0.9)
    trace = await rig.run(scripted, text=TO_NORTH)
    [request] = requests(rig)
    assert (request.asked, request.readings[0]) == (NORTH, EAST)
    assert request.state == "may_be_misunderstood"
    assert trace.attempts[-1].aside.endswith(", as the second reader read it")
    assert rig.state.picture is not None
    assert rig.state.picture.assets["Drone_T04"].at == "NorthGate"


async def test_what_an_unsure_second_reader_says_is_offered_and_the_doubt_told(rig: Rig) -> None:
    scripted = engine([EAST], [EAST], sure=0.5)
    scripted.second_reader = reader(NORTH, 0.2)
    await rig.run(scripted, text=TO_EAST)
    [request] = requests(rig)
    assert request.asked == EAST
    assert NORTH in request.readings
    assert request.state == "may_be_misunderstood"


async def test_without_an_answer_of_the_second_reader_the_first_plan_stands(rig: Rig) -> None:
    scripted = engine([EAST], [EAST], sure=0.4)
    scripted.second_reader = reader(EngineDiedError("the process died"), 0.9)
    await rig.run(scripted, text=TO_EAST)
    [read], [request] = read_again(rig), requests(rig)
    assert (read.asked, read.error != "") == ("", True)
    assert request.plan.actions[0].command == "move_to EastGate"


async def test_a_second_reader_that_never_answers_is_not_waited_for(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(second_reader, "PATIENCE_S", 0.05)
    scripted = engine([EAST], [EAST], sure=0.4)
    scripted.second_reader = reader(None, 0.9)
    await rig.run(scripted, text=TO_EAST)
    [read], [request] = read_again(rig), requests(rig)
    assert "no answer within" in read.error
    assert request.plan.actions[0].command == "move_to EastGate"


async def test_a_reading_that_comes_to_the_same_orders_bears_the_plan_out(rig: Rig) -> None:
    scripted = engine([EAST, EAST], [EAST], sure=0.4)
    scripted.second_reader = reader("asked: Drone_T04 to EastGate", 0.9)
    await rig.run(scripted, text=TO_EAST)
    [request] = requests(rig)
    assert request.plan.actions[0].command == "move_to EastGate"
    assert (request.read_apart, request.state) == (False, "approve")
    assert "asked: Drone_T04 to EastGate" not in request.readings


@pytest.mark.parametrize(
    ("text", "moves"),
    [("A car is at the east gate. One drone there.", True), ("Send one drone over there.", False)],
)
async def test_a_plan_for_want_of_a_place_replaces_none_that_serves_all_words(
    rig: Rig, text: str, moves: bool
) -> None:
    nowhere = "asked: 1 drone to unknown place"
    held = plan(("Drone_T04", "hold"), reason=f"{nowhere}; no such place (CAP-06), hold")
    said = [words for asked in (EAST, nowhere) for words in verdicts(asked)]
    chances = [(answer(EAST).index("EastGate"), math.log(0.05))]
    scripted = ScriptedEngine([answer(EAST), held], said, chances=chances)
    scripted.model = replace(scripted.model, prompts="compact")
    scripted.second_reader = reader(nowhere, 0.99)
    await rig.run(scripted, text=text)
    [request] = requests(rig)
    assert [action.verb for action in request.plan.actions] == ["move_to" if moves else "hold"]
    assert request.state != "approve"


async def test_what_it_alone_has_read_is_never_plain_approve(rig: Rig) -> None:
    scripted = engine([EAST, NORTH], [EAST, NORTH], sure=0.4)
    scripted.second_reader = reader(NORTH, 1.0)
    await rig.run(scripted, text=TO_NORTH)
    [request] = requests(rig)
    assert request.read_apart
    assert request.state == "may_be_misunderstood"


async def test_what_the_operator_chose_is_not_read_again(rig: Rig) -> None:
    scripted = engine([EAST, NORTH, NORTH], [EAST, NORTH, NORTH], sure=0.4)
    scripted.second_reader = reader(NORTH, 0.2)
    trace = await rig.run(scripted, text=TO_NORTH, approver=choosing(NORTH))
    assert len(read_again(rig)) == 1
    assert trace.status == "verified"
