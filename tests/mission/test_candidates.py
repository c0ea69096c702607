"""When the first plan breaks a rule, others are looked at, and all of them are in the trace."""

import json
import math

import pytest

from pa_console.mission.approval import standing_approver
from pa_console.mission.plan import MOST_SERVED
from pa_console.schema.evaluation import Variant
from pa_console.schema.events import event as ev
from pa_console.session.confidence import (
    Evidence,
    WeighedReading,
    calibrated_confidence,
    weighed,
)
from tests.rig import Rig
from tests.scripted import FAILURE, SUCCESS, ScriptedEngine, plan

STRIPS = plan(("Drone_T01", "move_to EastGate"))
STRIPS_TOO = plan(("Drone_T02", "move_to EastGate"))
SOUND = plan(("Drone_T04", "move_to EastGate"))
REPORT = plan(("Drone_T04", "report"))


async def test_the_first_sound_one_of_several_is_put_to_the_operator(rig: Rig) -> None:
    others = [STRIPS_TOO, SOUND, REPORT]
    trace = await rig.run(ScriptedEngine([STRIPS], others=others))
    assert trace.status == "verified"
    assert rig.state.picture is not None
    assert rig.state.picture.assets["Drone_T04"].at == "EastGate"
    proposed = [e.data for e in rig.events if e.data.kind == "plan_proposed"]
    assert [p.instead_of for p in proposed] == [None, 1, 1, 1]
    checked = [e.data.attempt for e in rig.events if e.data.kind == "plan_checked"]
    assert checked == [1, 2, 3]


async def test_what_comes_twice_is_looked_at_once(rig: Rig) -> None:
    others = [REPORT, SOUND, SOUND]
    await rig.run(ScriptedEngine([STRIPS], others=others))
    proposed = [e.data for e in rig.events if e.data.kind == "plan_proposed"]
    assert [p.text for p in proposed] == [STRIPS, REPORT, SOUND]


async def test_a_sound_first_plan_asks_for_no_others(rig: Rig) -> None:
    await rig.run(ScriptedEngine([SOUND], others=[REPORT]), approver=standing_approver("auto"))
    assert [e.data.text for e in rig.events if e.data.kind == "plan_proposed"] == [SOUND]


SLOW_RELIEF = plan(("Robot_T02", "move_to WestGate"), ("Drone_T01", "return_to_base"))


async def test_the_last_guard_of_a_gate_leaves_once_a_slow_relief_has_arrived(rig: Rig) -> None:
    trace = await rig.run(
        ScriptedEngine([SLOW_RELIEF]), text="Let another asset relieve Drone_T01."
    )
    assert trace.status == "verified"
    first, second = trace.attempts
    assert first.findings
    assert "WF-03" in [finding.rule_id for finding in first.findings if finding.broken]
    assert second.plan is not None
    assert [action.after for action in second.plan.actions] == [(), (1,)]
    assert rig.state.picture is not None
    posts = {name: rig.state.picture.assets[name].post for name in ("Robot_T02", "Drone_T01")}
    assert posts == {"Robot_T02": "WestGate", "Drone_T01": "Base"}
    pictures = [e.data.picture for e in rig.events if isinstance(e.data, ev.TelemetryReceived)]
    assert all(picture.gates["WestGate"].covered for picture in pictures)


async def test_assets_that_change_places_do_not_wait_for_each_other(rig: Rig) -> None:
    swap = plan(("Drone_T01", "move_to NorthGate"), ("Drone_T02", "move_to WestGate"))
    trace = await rig.run(ScriptedEngine([swap]), text="Swap Drone_T01 and Drone_T02.")
    assert all(
        action.after == () for each in trace.attempts if each.plan for action in each.plan.actions
    )


ASTRAY = plan(
    ("Drone_T04", "move_to WestGate"), reason="asked: 1 drone to EastGate; Free drone: Drone_T04"
)


async def test_a_plan_that_is_not_what_its_planner_says_was_asked_gives_way(rig: Rig) -> None:
    trace = await rig.run(ScriptedEngine([ASTRAY], others=[REPORT, SOUND]))
    assert trace.status == "verified"
    assert rig.state.picture is not None
    assert rig.state.picture.assets["Drone_T04"].at == "EastGate"
    asked = [e.data.attempt for e in rig.events if e.data.kind == "approval_requested"]
    assert asked == [3]


async def test_the_other_plans_say_the_same_of_what_was_asked(rig: Rig) -> None:
    engine = ScriptedEngine([ASTRAY], others=[SOUND])
    await rig.run(engine)
    assert [request.begun for request in engine.several] == [
        '{"reason": "asked: 1 drone to EastGate; '
    ]


async def test_another_plan_for_the_same_is_as_doubtful_as_the_first(rig: Rig) -> None:
    chances = [(ASTRAY.index("EastGate"), math.log(0.4))]
    trace = await rig.run(ScriptedEngine([ASTRAY], others=[SOUND], chances=chances))
    assert [attempt.confidence for attempt in trace.attempts] == [0.4, 0.4]
    told = calibrated_confidence(Evidence(0.4))
    assert told is not None
    assert f"{told:.0%} confidence" in trace.attempts[-1].doubt


async def test_commands_that_are_given_make_the_reading_no_surer(rig: Rig) -> None:
    chances = [(ASTRAY.index("EastGate"), math.log(0.4))]
    trace = await rig.run(ScriptedEngine([ASTRAY, SERVES_EAST], others=[ASTRAY], chances=chances))
    assert [(a.given, a.confidence) for a in trace.attempts][-1] == (True, 0.4)


async def test_where_none_says_what_was_asked_the_other_plans_begin_as_they_like(rig: Rig) -> None:
    engine = ScriptedEngine([STRIPS], others=[SOUND])
    await rig.run(engine)
    assert [request.begun for request in engine.several] == [""]


async def test_if_no_other_plan_is_nearer_to_what_was_asked_the_first_stays(rig: Rig) -> None:
    await rig.run(ScriptedEngine([ASTRAY], others=[STRIPS, ASTRAY]))
    asked = [e.data.attempt for e in rig.events if e.data.kind == "approval_requested"]
    assert asked == [1]


async def test_what_nothing_blocks_does_not_go_back_to_the_planner(rig: Rig) -> None:
    await rig.run(ScriptedEngine([ASTRAY, *[STRIPS] * MOST_SERVED, SOUND], others=[STRIPS]))
    assert "repair_requested" not in rig.kinds()
    asked = [e.data.attempt for e in rig.events if e.data.kind == "approval_requested"]
    assert asked == [1]


async def test_without_fitting_the_first_sound_plan_stays(rig: Rig) -> None:
    rig.variant = Variant(fitting=False)
    await rig.run(ScriptedEngine([ASTRAY], others=[SOUND]))
    assert rig.kinds().count("plan_proposed") == 1


async def test_when_none_is_sound_the_faults_go_back_to_the_planner(rig: Rig) -> None:
    await rig.run(ScriptedEngine([STRIPS, SOUND], others=[STRIPS_TOO]))
    kinds = [
        e.data.kind for e in rig.events if e.data.kind in ("plan_proposed", "repair_requested")
    ]
    assert kinds == ["plan_proposed", "plan_proposed", "repair_requested", "plan_proposed"]


TO_EAST = "Send a drone to the east gate."
SAYS_EAST = "asked: 1 drone to EastGate; planned: hold; 0 of 1 drone to EastGate"
OBJECTS = json.dumps({"rules": [], "feedback": SAYS_EAST, "verdict": "Failure"})
SERVES_EAST = plan(
    ("Drone_T04", "move_to EastGate"), reason="asked: 1 drone to EastGate; Free drone: Drone_T04"
)


def proposed(rig: Rig) -> list[tuple[int, bool, bool]]:
    data = (e.data for e in rig.events if e.data.kind == "plan_proposed")
    return [(p.attempt, p.given, p.as_judged) for p in data]


def asked_about(rig: Rig) -> list[tuple[int, bool]]:
    data = (e.data for e in rig.events if e.data.kind == "approval_requested")
    return [(a.attempt, a.needs_override) for a in data]


NOTHING = plan(("Drone_T04", "hold"), reason="asked: 1 drone to unknown place; no such place, hold")


async def test_where_the_judge_reads_something_to_do_it_is_put_to_the_operator(rig: Rig) -> None:
    trace = await rig.run(ScriptedEngine([NOTHING, SERVES_EAST], [OBJECTS, SUCCESS]), text=TO_EAST)
    assert trace.status == "verified"
    assert proposed(rig) == [(1, False, False), (2, True, True)]
    assert trace.attempt(2).aside == (
        ", instead of 1, its commands given by the console, as the judge read it"
    )
    assert asked_about(rig) == [(2, False)]
    assert rig.state.picture is not None
    assert rig.state.picture.assets["Drone_T04"].at == "EastGate"


async def test_a_plan_for_the_judges_reading_that_it_does_not_pass_is_not_put(rig: Rig) -> None:
    await rig.run(ScriptedEngine([NOTHING, SERVES_EAST], [OBJECTS]), text=TO_EAST)
    assert len(proposed(rig)) == 2
    assert asked_about(rig) == [(1, True)]


async def test_a_blocked_plan_for_the_judges_reading_is_not_put(rig: Rig) -> None:
    await rig.run(ScriptedEngine([NOTHING, STRIPS], [OBJECTS, SUCCESS]), text=TO_EAST)
    assert rig.kinds().count("plan_judged") == 1
    assert asked_about(rig) == [(1, True)]


@pytest.mark.parametrize(
    ("first", "verdict"),
    [
        pytest.param(SERVES_EAST, OBJECTS, id="a plan that does something"),
        pytest.param(NOTHING, FAILURE, id="a judge that does not say what was asked"),
        pytest.param(NOTHING, SUCCESS, id="a judge that agrees"),
        pytest.param(
            plan(("Drone_T04", "hold"), reason="asked: use force at EastGate; no force, hold"),
            OBJECTS,
            id="a refusal of what no order may have done",
        ),
    ],
)
async def test_the_first_plan_stands_for(rig: Rig, first: str, verdict: str) -> None:
    await rig.run(ScriptedEngine([first, SERVES_EAST], [verdict, SUCCESS]), text=TO_EAST)
    assert len(proposed(rig)) == 1


async def test_without_a_second_reading_a_plan_that_does_nothing_stands(rig: Rig) -> None:
    rig.variant = Variant(second_reading=False)
    await rig.run(ScriptedEngine([NOTHING, SERVES_EAST], [OBJECTS, SUCCESS]), text=TO_EAST)
    assert asked_about(rig) == [(1, True)]


@pytest.mark.parametrize(
    ("sure", "judge", "gaps", "preferred"),
    [
        (0.3, 0.6, 0, "judge"),
        pytest.param(0.3, 0.2, 0, "planner", id="the judge is less sure"),
        pytest.param(0.3, 0.3, 1, "planner", id="the judge leaves a part out"),
    ],
)
def test_a_surer_judge_is_believed_where_the_planner_is_unsure(
    sure: float, judge: float, gaps: int, preferred: str
) -> None:
    readings = weighed(
        [
            WeighedReading("asked: 1 drone to WestGate", "planner", Evidence(sure)),
            WeighedReading("asked: 1 drone to EastGate", "judge", Evidence(judge=judge, gaps=gaps)),
        ]
    )
    assert readings[0].reader == preferred
