"""Plans in canonical words, and how one plan is told apart from another."""

import random

from hypothesis import given
from hypothesis import strategies as st
from pa_training.samples.judge_labels import difference

from pa_console.language.canonical.reading import planned
from pa_console.schema.command import COMMANDS
from pa_console.schema.plan import Action
from pa_training.situations.worlds import shipped_world

WORLD = shipped_world()


def acts(*texts: str) -> list[Action]:
    """Return actions written as `Agent command`."""
    return [Action(agent=t.split()[0], command=t.partition(" ")[2]) for t in texts]


@st.composite
def plans(draw: st.DrawFn) -> list[Action]:
    agents = draw(st.lists(st.sampled_from(sorted(WORLD.assets)), unique=True, max_size=5))
    found: list[Action] = []
    for agent in agents:
        specs = [(v, s) for v, s in COMMANDS.items() if WORLD.assets[agent].kind in s.kinds]
        verb, spec = draw(st.sampled_from(specs))
        place = f" {draw(st.sampled_from(WORLD.gates))}" if spec.takes_frame else ""
        found.append(Action(agent=agent, command=f"{verb}{place}"))
    return found


def test_kinds_are_counted_and_names_are_told_on_demand() -> None:
    plan = acts("Drone_T01 move_to EastGate", "Drone_T02 move_to EastGate", "Ugv_T01 report")
    assert planned(plan, WORLD, by_name=False) == "2 drones to EastGate; report by 1 vehicle"
    told = "Drone_T01, Drone_T02 to EastGate; report by Ugv_T01"
    assert planned(plan, WORLD, by_name=True) == told


def test_one_hold_is_hold_whoever_does_it() -> None:
    assert planned(acts("Ugv_T01 hold"), WORLD, by_name=False) == "hold"


@given(plans(), st.randoms(use_true_random=False))
def test_the_order_of_actions_makes_no_difference(plan: list[Action], rng: random.Random) -> None:
    turned = list(plan)
    rng.shuffle(turned)
    assert difference(plan, turned, set(WORLD.assets), WORLD).size == 0


@given(plans(), plans())
def test_what_is_missing_here_is_too_much_there(one: list[Action], other: list[Action]) -> None:
    there, back = difference(one, other, (), WORLD), difference(other, one, (), WORLD)
    assert len(there.missing) - len(there.extra) == len(one) - len(other)
    assert len(back.missing) - len(back.extra) == len(other) - len(one)


def test_another_asset_matters_only_where_it_is_named() -> None:
    right, plan = acts("Drone_T01 move_to EastGate"), acts("Drone_T02 move_to EastGate")
    assert difference(right, plan, (), WORLD).size == 0
    assert difference(right, plan, ("Drone_T01",), WORLD).others


def test_places_steps_and_additions_are_told_apart() -> None:
    right = acts("Robot_T01 identify EastGate")
    assert difference(right, acts("Robot_T01 identify WestGate"), (), WORLD).places
    assert difference(right, acts("Robot_T01 warn EastGate"), (), WORLD).steps
    more = acts("Robot_T01 identify EastGate", "Ugv_T01 hold")
    assert difference(right, more, (), WORLD).extra == more[1:]


def test_flying_and_watching_come_to_the_same() -> None:
    right, plan = acts("Drone_T01 observe EastGate"), acts("Drone_T01 move_to EastGate")
    assert difference(right, plan, ("Drone_T01",), WORLD).size == 0
