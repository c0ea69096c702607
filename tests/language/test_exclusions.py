"""What an order rules out is never used, whatever is read of the rest."""

import asyncio
import random
from dataclasses import replace

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.canonical.order import Ask, Who
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
from pa_training.order_generator.orders import Order, canonical_order
from pa_training.order_generator.sampler import sample_order
from pa_training.samples.reading_samples import NO_TIME
from pa_training.situations.situations import random_situation
from pa_training.situations.worlds import random_world, shipped_world

ORDERS = 5000
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


def test_exclusions_are_written_read_and_told(checkpoint: World) -> None:
    order = Order(
        (Ask(task="go", who=Who(kind="robot"), place="NorthGate"),),
        others_stay=True,
        excluded=("Robot_T01", "Robot_T02"),
    )
    there = random_situation(random.Random(4), checkpoint)
    words = canonical_order(order, checkpoint, there.picture, there.digest)
    assert words == "1 robot to NorthGate; except Robot_T01, Robot_T02; others stay"
    reading = read_asked(f"asked: {words}")
    assert reading is not None
    assert (reading.excluded, reading.others_stay) == (order.excluded, True)
    reason = f"asked: {words}; Free robot: none"
    assert asked_words(reason) == f"asked: {words}; "
    assert read_reason(reason) == reading
    assert plain_reading(f"asked: {words}") == (
        "send 1 ground robot to NorthGate, without Robot_T01 and Robot_T02; all others stay"
    )


def test_nobody_who_is_ruled_out_is_ever_commanded() -> None:
    rng, left = random.Random(20261127), ORDERS
    while left:
        there = random_situation(rng, random_world(rng))
        world, picture, digest = there.world, there.picture, there.digest
        names = list(world.assets)
        for _ in range(min(left, 50)):
            order, _kind = sample_order(rng, world, picture, digest)
            asks = (*order.asks, *order.otherwise)
            spoken_of = {n for ask in asks for n in (*ask.who.names, ask.leaving)}
            excluded = tuple(rng.sample([n for n in names if n not in spoken_of] or names, 1))
            order = replace(order, excluded=excluded)
            words = canonical_order(order, world, picture, digest)
            reading = read_asked(f"asked: {words}")
            assert reading is not None
            assert reading.excluded == excluded
            left -= 1
            for slots in commands_serving(reading, world, picture):
                acting = {n for s in slots for n in s.agents if s.verb not in ("hold", "report")}
                assert not acting & {*excluded} - spoken_of, (words, slots)
            (name,) = excluded
            said = rng.choice(WAYS).format(order="send somebody to the base", name=name)
            assert excluded_names(world, said) == (name,), said
            plan = Plan(reason="", actions=(Action(agent=name, command="return_to_base"),))
            assert ruled_out(plan, world, said), said
