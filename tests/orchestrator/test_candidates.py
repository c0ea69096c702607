"""When the first plan breaks a rule, others are looked at, and all of them are in the trace."""

import pytest

from pa_console.orchestrator.headless import standing_approver
from pa_console.schema.variant import Variant
from tests.orchestrator.conftest import Rig
from tests.scripted import FAILURE, SUCCESS, ScriptedEngine, plan

STRIPS = plan(("Drone_T01", "move_to EastGate"))
STRIPS_TOO = plan(("Drone_T02", "move_to EastGate"))
SOUND = plan(("Drone_T04", "move_to EastGate"))
REPORT = plan(("Drone_T04", "report"))


@pytest.fixture
def second_look(rig: Rig) -> Rig:
    """Return the rig with two other plans for the judge where it objects to one."""
    rig.variant = Variant(reconsidered=2)
    return rig


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


async def test_where_none_says_what_was_asked_the_other_plans_begin_as_they_like(rig: Rig) -> None:
    engine = ScriptedEngine([STRIPS], others=[SOUND])
    await rig.run(engine)
    assert [request.begun for request in engine.several] == [""]


async def test_if_no_other_plan_is_nearer_to_what_was_asked_the_first_stays(rig: Rig) -> None:
    await rig.run(ScriptedEngine([ASTRAY], others=[STRIPS, ASTRAY]))
    asked = [e.data.attempt for e in rig.events if e.data.kind == "approval_requested"]
    assert asked == [1]


async def test_what_nothing_blocks_does_not_go_back_to_the_planner(rig: Rig) -> None:
    await rig.run(ScriptedEngine([ASTRAY, STRIPS, SOUND], others=[STRIPS]))
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


async def test_a_trained_judges_objection_brings_up_the_next_sound_plan(second_look: Rig) -> None:
    others = [STRIPS, SOUND]
    engine = ScriptedEngine([REPORT], [FAILURE, SUCCESS], others=others, trained=True)
    trace = await second_look.run(engine)
    assert trace.status == "verified"
    assert second_look.state.picture is not None
    assert second_look.state.picture.assets["Drone_T04"].at == "EastGate"
    judged = [e.data.attempt for e in second_look.events if e.data.kind == "plan_judged"]
    assert judged == [1, 3]
    asked = [e.data.attempt for e in second_look.events if e.data.kind == "approval_requested"]
    assert asked == [3]


async def test_if_the_judge_passes_no_other_plan_its_first_objection_stands(
    second_look: Rig,
) -> None:
    others = [SOUND, plan(("Drone_T04", "hold")), plan(("Robot_T01", "report"))]
    engine = ScriptedEngine([REPORT], [FAILURE], others=others, trained=True)
    trace = await second_look.run(engine)
    assert trace.status == "rejected"
    judged = [e.data.attempt for e in second_look.events if e.data.kind == "plan_judged"]
    assert judged == [1, 2, 3]
    approval = next(e.data for e in second_look.events if e.data.kind == "approval_requested")
    assert (approval.attempt, approval.needs_override) == (1, True)


async def test_the_same_orders_are_not_judged_again(second_look: Rig) -> None:
    others = [plan(("Drone_T04", "report"), reason="said otherwise")]
    await second_look.run(ScriptedEngine([REPORT], [FAILURE], others=others, trained=True))
    assert second_look.kinds().count("plan_judged") == 1


async def test_by_default_an_objection_asks_for_no_other_plan(rig: Rig) -> None:
    await rig.run(ScriptedEngine([REPORT], [FAILURE, SUCCESS], others=[SOUND], trained=True))
    assert rig.kinds().count("plan_proposed") == 1


async def test_an_untrained_judges_objection_asks_for_no_other_plan(second_look: Rig) -> None:
    await second_look.run(ScriptedEngine([REPORT], [FAILURE, SUCCESS], others=[SOUND]))
    assert second_look.kinds().count("plan_proposed") == 1
