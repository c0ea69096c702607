"""What an order rules out is never used, whatever is read of the rest."""

import asyncio
import random
from datetime import UTC, datetime

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.canonical.reading import (
    asked_words,
    plain_reading,
    read_asked,
    read_reason,
)
from pa_console.language.exclusions import excluded_names
from pa_console.mission.examine import examine, ruled_out
from pa_console.mission.planning.choices import commands_serving
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_training.situations.worlds import shipped_world
from tests.written import SITUATIONS, given

NO_TIME = datetime(2026, 1, 1, tzinfo=UTC)
WAYS = (
    "{order}, but not {name}", "{order}, anyone but {name}", "{order}, except {name}",
    "{order}. Leave {name} out of it.", "Don't use {name}: {order}",
    "{order}; {name} is off limits", "{order}, other than {name}",
    "{order} without using {name}", "{order}. Not {name} though.",
)  # fmt: skip


@pytest.fixture(scope="module")
def checkpoint() -> World:
    return shipped_world()


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("Send a robot to north, but not Robot_T01", ["Robot_T01"]),
        ("a second guard on west from the spares, just not D4", ["Drone_T04"]),
        ("Anyone but Drone_T02 or Drone_T03 to the east gate", ["Drone_T02", "Drone_T03"]),
        ("Leave R1 out of it and cover west", ["Robot_T01"]),
        ("Send a drone, not to north but to south", ["NorthGate"]),
        ("Robot_T02 is not to be used. Cover WestGate.", ["Robot_T02"]),
        ("a robot to north but leave R1 out of it", ["Robot_T01"]),
        ("If a drone is free send it west, if not Robot_T01", []),
        ("Not Drone_T04, the robot at the base.", []),
        ("Robot_T02, not Drone_T04!", []),
        ("Send Drone_T04 to the north gate", []),
        ("Don't send Drone_T04 to north, send Drone_T04 to south", []),
        ('He said "anyone but Drone_T04". Send Drone_T04 east.', []),
        ("Don't leave NorthGate without a guard", []),
        ("Robot_T01 is not available, cover WestGate for it", []),
    ],
)
def test_what_the_words_rule_out(checkpoint: World, text: str, names: list[str]) -> None:
    assert list(excluded_names(checkpoint, text)) == names


def test_a_plan_that_uses_what_is_ruled_out_is_blocked(checkpoint: World) -> None:
    plan = Plan(
        reason="asked: 1 robot to NorthGate",
        actions=(Action(agent="Robot_T01", command="move_to NorthGate"),),
    )
    (finding,) = ruled_out(plan, checkpoint, "Send a robot to north, but not Robot_T01")
    assert finding.blocking
    assert finding.message == "the order rules Robot_T01 out"
    assert not ruled_out(plan, checkpoint, "Send a robot to north")


def test_what_the_order_rules_out_holds_in_every_phase_of_it(checkpoint: World) -> None:
    plan = Plan(reason="", actions=(Action(agent="Robot_T01", command="move_to WestGate"),))
    phase = Mission(id="M", text="identify who is at WestGate", created=NO_TIME)
    order = "Someone is at the west gate, see to it, but leave Robot_T01 out of it."
    fleet = SimulatedFleet(Checkpoint(checkpoint))
    found = asyncio.run(examine(plan, phase, fleet, Rulebook("none", "", ()), order=order))
    assert found.faults == ("ORDER: the order rules Robot_T01 out",)


def test_exclusions_are_read_and_told() -> None:
    words = "1 robot to NorthGate; except Robot_T01, Robot_T02; others stay"
    reading = read_asked(f"asked: {words}")
    assert reading is not None
    assert (reading.excluded, reading.others_stay) == (("Robot_T01", "Robot_T02"), True)
    reason = f"asked: {words}; Free robot: none"
    assert asked_words(reason) == f"asked: {words}; "
    assert read_reason(reason) == reading
    assert plain_reading(f"asked: {words}") == (
        "send 1 ground robot to NorthGate, without Robot_T01 and Robot_T02; all others stay"
    )


@pytest.mark.parametrize("number", range(SITUATIONS))
def test_nobody_who_is_ruled_out_is_ever_commanded(number: int) -> None:
    rng = random.Random(number)
    there, orders = given(number)
    world, names = there.world, list(there.world.assets)
    for one in orders:
        if one.order.reading.excluded or not one.order.reading.asks:
            continue
        for name in (name for name in names if name not in one.order.named):
            clauses, stay, limits = one.order.asked.partition("; others stay")
            words = f"{clauses}; except {name}{stay}{limits}"
            reading = read_asked(words)
            assert reading is not None
            assert reading.excluded == (name,)
            for slots in commands_serving(reading, world, there.picture):
                acting = {n for s in slots for n in s.agents if s.verb not in ("hold", "report")}
                assert name not in acting, (words, slots)
    for name in names:
        said = rng.choice(WAYS).format(order="send somebody to the base", name=name)
        assert excluded_names(world, said) == (name,), said
        plan = Plan(reason="", actions=(Action(agent=name, command="return_to_base"),))
        assert ruled_out(plan, world, said), said
