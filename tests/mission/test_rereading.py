"""Where the models are unsure of an order, the operator is offered what else it may mean."""

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from pa_console.language.canonical.reading import agree, distinct
from pa_console.language.clause_grammar import exactly
from pa_console.llm.backend import EngineDiedError
from pa_console.mission import readings as second_reader
from pa_console.mission.approval import Approver, standing_approver
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset
from pa_console.schema.mission import Decision
from pa_console.session.confidence import UNSURE
from pa_console.station.station import ControlStation
from pa_console.views.event_words import event_in_words
from tests.rig import Rig
from tests.scripted import Answer, ScriptedEngine, judged, plan

EAST = "asked: 1 drone to EastGate"
NORTH = "asked: 1 drone to NorthGate"
SOUTH = "asked: 1 drone to SouthGate"
FREE = "Free drone: Drone_T04"


def answer(asked: str) -> str:
    """Return a plan that sends the free drone where `asked` says."""
    place = asked.rpartition(" ")[2]
    return plan(("Drone_T04", f"move_to {place}"), reason=f"{asked}; {FREE}")


def begun(asked: str) -> str:
    """Return how a planner's answer might begin instead."""
    return f'{{"reason": "{asked}; {FREE}", "actions": ['


def engine(asked: Sequence[str], read: Sequence[str], sure: float) -> ScriptedEngine:
    """Return one whose planner plans for each of `asked`, and whose judge reads each of `read`."""
    plans = [answer(words) for words in asked]
    said = [text for words in read for text in judged(words)]
    chances = [(plans[0].index("EastGate"), math.log(sure))]
    others = [begun(EAST), begun(NORTH), begun(SOUTH), begun(NORTH)]
    scripted = ScriptedEngine(plans, said, others, chances)
    scripted.model = replace(scripted.model, prompts="compact")
    return scripted


def choosing(asked: str) -> Approver:
    """Return an operator who says that `asked` was meant, where that is offered, and approves."""
    approve = standing_approver("auto")

    def decide(request: ev.ApprovalRequested) -> Decision:
        if asked in request.readings:
            return Decision(kind="choose", request_id=request.request_id, asked=asked)
        return approve(request)

    return decide


def requests(rig: Rig) -> list[ev.ApprovalRequested]:
    return [e.data for e in rig.events if isinstance(e.data, ev.ApprovalRequested)]


async def test_the_judges_reading_comes_first_and_none_comes_twice(rig: Rig) -> None:
    await rig.run(engine([EAST], [SOUTH], sure=0.3))
    [request] = requests(rig)
    assert (request.asked, request.readings) == (EAST, (SOUTH, NORTH))
    assert "or: send 1 drone to SouthGate | or: send 1 drone to NorthGate" in event_in_words(
        request
    )


async def test_an_order_that_was_read_surely_is_not_read_again(rig: Rig) -> None:
    scripted = engine([EAST], [EAST], sure=0.9)
    await rig.run(scripted)
    assert [(request.asked, request.readings) for request in requests(rig)] == [("", ())]
    assert scripted.several == []


async def test_where_the_judge_read_something_else_that_is_offered(rig: Rig) -> None:
    scripted = engine([EAST], [SOUTH], sure=0.9)
    await rig.run(scripted)
    assert [request.readings for request in requests(rig)] == [(SOUTH,)]
    assert scripted.several == []


async def test_what_the_operator_meant_is_planned_judged_and_done(rig: Rig) -> None:
    scripted = engine([EAST, NORTH], [EAST, NORTH], sure=0.3)
    trace = await rig.run(scripted, approver=choosing(NORTH))
    assert trace.status == "verified"
    assert rig.state.picture is not None
    assert rig.state.picture.assets["Drone_T04"].at == "NorthGate"
    assert [(a.as_chosen, a.doubt == "") for a in trace.attempts] == [(False, False), (True, True)]
    assert trace.attempts[-1].aside == ", as the operator meant it"
    assert [made.decision.kind for made in trace.decisions] == ["choose", "approve"]
    [_, second] = [r for r in scripted.requests if r.role == "planner"]
    [first, again] = [r for r in scripted.requests if r.role == "judge" and "ASKED" in r.grammar]
    assert exactly(NORTH) in second.grammar
    assert exactly(NORTH) in again.grammar
    assert exactly(NORTH) not in first.grammar


async def test_what_was_read_at_first_can_be_taken_up_again(rig: Rig) -> None:
    scripted = engine([EAST, NORTH, EAST], [EAST, NORTH, EAST], sure=0.3)
    taken = iter((NORTH, EAST))

    def decide(request: ev.ApprovalRequested) -> Decision:
        asked = next(taken, "")
        if asked:
            assert asked in request.readings
            return Decision(kind="choose", asked=asked)
        return standing_approver("auto")(request)

    trace = await rig.run(scripted, approver=decide)
    assert rig.state.picture is not None
    assert rig.state.picture.assets["Drone_T04"].at == "EastGate"
    assert [made.decision.asked for made in trace.decisions] == [NORTH, EAST, ""]
    assert len(scripted.several) == 1


async def test_a_plan_that_must_be_made_anew_is_for_the_reading_that_was_chosen(rig: Rig) -> None:
    def fail_before_decision(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.ApprovalRequested) and event.data.attempt == 2:
            station.inject(FailAsset(asset="Drone_T04"))

    scripted = engine([EAST, NORTH], [EAST, NORTH], sure=0.3)
    trace = await rig.run(scripted, approver=choosing(NORTH), on_event=fail_before_decision)
    assert "Drone_T04" in trace.voided
    planned = [r for r in scripted.requests if r.role == "planner"]
    assert len(planned) > 2
    assert all(exactly(NORTH) in request.grammar for request in planned[1:])


async def test_a_reading_that_was_not_offered_is_not_taken(rig: Rig) -> None:
    answers = iter((Decision(kind="choose", asked="asked: 1 drone to WestGate"),))

    def decide(request: ev.ApprovalRequested) -> Decision:
        return next(answers, None) or standing_approver("auto")(request)

    trace = await rig.run(engine([EAST], [EAST], sure=0.3), approver=decide)
    assert [made.accepted for made in trace.decisions] == [False, True]
    assert trace.decisions[0].detail == "no such reading was offered"


async def test_with_no_readings_looked_at_none_is_offered(rig: Rig) -> None:
    rig.variant = rig.variant.model_copy(update={"readings": 0})
    await rig.run(engine([EAST], [NORTH], sure=0.3))
    assert [request.readings for request in requests(rig)] == [()]


def test_whom_a_gate_has_lost_makes_no_other_reading() -> None:
    lost = "asked: cover Ugv_T01 at EastGate"
    assert distinct("asked: cover EastGate", [lost]) == ()
    assert distinct(lost, ["asked: cover WestGate", "asked: cover EastGate by 1 drone"]) == (
        "asked: cover WestGate",
        "asked: cover EastGate by 1 drone",
    )


def test_to_send_somebody_to_the_base_is_to_send_them_home() -> None:
    home, to_base = "asked: Drone_T04 home", "asked: Drone_T04 to Base"
    assert distinct(home, [to_base], "Base") == ()
    assert distinct(home, [to_base], "Depot") == (to_base,)
    assert agree(home, to_base, "Base")


def test_names_in_another_order_or_one_by_one_make_no_other_reading() -> None:
    both = "asked: Robot_T01, Ugv_T02 to Checkpoint"
    apart = "asked: Ugv_T02 to Checkpoint; Robot_T01 to Checkpoint"
    assert distinct(both, ["asked: Ugv_T02, Robot_T01 to Checkpoint", apart]) == ()
    assert not agree(both, "asked: Robot_T01 to Checkpoint")


def test_two_of_a_kind_are_more_than_one() -> None:
    one = "asked: 1 drone to NorthGate"
    assert not agree(one, f"{one}; 1 drone to NorthGate")


@pytest.mark.parametrize(
    ("others", "kept"),
    [
        ([NORTH, NORTH], (NORTH,)),
        (["", "asked: do something", "asked: if there is a moon: hold"], ()),
        ([f"{EAST}; others stay"], (f"{EAST}; others stay",)),
        (
            ["asked: 1 drone from EastGate to EastGate", "asked: 1 drone from EastGate home"],
            ("asked: 1 drone from EastGate home",),
        ),
        (["asked: use force at NorthGate", "asked: chase beyond the perimeter"], ()),
        (
            ["asked: use force at NorthGate; 1 drone to NorthGate"],
            ("asked: use force at NorthGate; 1 drone to NorthGate",),
        ),
        (["asked: if track at WestGate: hold, else: 1 drone to EastGate; now: x, not so"], ()),
    ],
)
def test_what_comes_to_the_same_now_or_cannot_be_read_is_left_out(
    others: list[str], kept: tuple[str, ...]
) -> None:
    assert distinct(EAST, others) == kept


TO_EAST = "Send a drone to EastGate."
TO_NORTH = "Send a drone to NorthGate."


def reader(asked: Answer, sure: float) -> ScriptedEngine:
    """Return a trained second reader that says that so much was `asked`, and how sure it is."""
    said = judged(asked)[0] if isinstance(asked, str) else asked
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
    said = [words for asked in (EAST, nowhere) for words in judged(asked)]
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
