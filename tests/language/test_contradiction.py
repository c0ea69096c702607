"""An order that demands and forbids the same is noticed, and no consistent order is."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.evaluation.jobs import load_with_worlds
from pa_console.language.demands import contradiction
from pa_console.resources import data_folder
from pa_console.sim.worlds.world_file import load_world
from tests import written

FOLDER = data_folder() / "worlds" / "checkpoint"
WORLD = load_world(FOLDER / "world.yaml")

CONTRADICTORY = (
    "Send Drone_T01 home. Do not send Drone_T01 home.",
    "Do not send Drone_T01 home. Send Drone_T01 home.",
    "Send drone one home but don't send drone one home",
    "Send Drone_T01 home and do not send it home.",
    "Drone_T01 must go home and must not go home.",
    "Move Drone_T04 to the east gate. Keep Drone_T04 where it is.",
    "Keep Robot_T01 at its post and send Robot_T01 to the north gate.",
    "Robot_T01 stays put; move Robot_T01 to the north gate.",
    "Drone_T04 to EastGate. Drone_T04 must not move.",
    "Send Drone_T04 to the east gate. Under no circumstances send Drone_T04 to the east gate.",
    "Send Drone_T04 to the east gate. Send Drone_T04 to the west gate.",
    "Send Drone_T04 to the east gate and to the west gate.",
    "Send Drone_T04 home. Send Drone_T04 to the north gate, please.",
    "Block the east gate with Ugv_T02. Never block the east gate.",
    "Do not observe the west gate. Observe the west gate with a drone.",
    "Send a drone to the east gate. Do not send any drone to the east gate.",
    "Send Drone_T04 to the east gate. No drone is to go to the east gate.",
    "Send Drone_T01 and Drone_T04 to the north gate. Do not send Drone_T04 to the north gate.",
    "Warn the vehicle at the west gate. Do not warn the vehicle at the west gate.",
    "Recall all drones. Do not recall any drone.",
    "Robot_T01 never leaves its post. Send Robot_T01 home.",
    "Avoid sending Ugv_T02 to the north gate; Ugv_T02 to the north gate.",
)
CONSISTENT = (
    "Send a drone to the east gate, but not Drone_T01.",
    "Send all drones home but do not send Drone_T01 home.",
    "Send Drone_T01 to the east gate. No, I mean the west gate.",
    "Send Drone_T01 to the east gate. Correction: send Drone_T01 to the west gate.",
    "Send Drone_T04 home. Scratch that, do not send Drone_T04 home.",
    "Send Drone_T04 to the east gate, then to the west gate.",
    "Send Drone_T04 to the east gate. Then send Drone_T04 home.",
    "First move Drone_T04 to the east gate, afterwards Drone_T04 goes to the base.",
    "Send Drone_T04 to the east gate and hold there.",
    "Send Drone_T04 to the east gate and keep it there.",
    "Send Drone_T04 from the west gate to the east gate.",
    "Do not send Drone_T01, send Drone_T04 to the east gate.",
    "Do not move Drone_T04 to the east gate; move Drone_T04 to the west gate.",
    "Send Drone_T04 to the east gate, not to the west gate.",
    "Send not Drone_T01 but Drone_T04 to the east gate.",
    "Send Drone_T04, not Drone_T01, to the east gate.",
    "Move Drone_T04 to the east gate. Keep Drone_T01 where it is.",
    "Send one drone to the east gate. Do not send two drones to the east gate.",
    "Send Drone_T04 to the east gate. Do not send any other drone to the east gate.",
    "Send Drone_T04 to the east gate, nobody else moves.",
    "Drone_T04 to the east gate, everyone else stays where they are.",
    "Don't forget to send Drone_T04 home. Send Drone_T04 home.",
    "Don't hesitate, send Drone_T04 home.",
    "If a car comes to the east gate, send Drone_T04 to the east gate. Otherwise do not send "
    "Drone_T04 to the east gate.",
    "Do not send Drone_T04 to the east gate until Robot_T01 is there. Send Drone_T04 to the north "
    "gate.",
    "Can't you send Drone_T04 home? Send Drone_T04 home.",
    "Block the east gate with Ugv_T02. Ugv_T01 must not block the east gate.",
    "Drone_T04 to EastGate, Robot_T01 to NorthGate, nobody leaves the west gate unguarded.",
    "Send Drone_T04 to the east gate or to the west gate.",
    "Do not let the west gate stay empty. Send Drone_T04 to the west gate.",
    "Identify the vehicle at the west gate, but do not warn it.",
    "Send Drone_T04 to the east gate. Do not go too close to the vehicle.",
    "Drone_T01 was not sent home yesterday. Send Drone_T01 home.",
    "Relieve Drone_T02 with Drone_T04 and send Drone_T02 home.",
    "Send Drone_T04 to the east gate with Robot_T01 and send Drone_T02 home.",
    "Swap Drone_T01 and Drone_T02.",
    "Do not leave Drone_T01 at the west gate, send Drone_T01 home.",
    "Robot_T01 holds. Robot_T01 never leaves its post.",
    "Do not send Drone_T01 to the west gate, keep Drone_T01 at the west gate.",
    "Keep Drone_T01 right there, don't wait.",
    "Move Robot_T01 to the east gate and Drone_T09 to the west gate.",
    "Drone_T04 to the west gate: Drone_T04 covers the south gate alone.",
    "Send Drone_T04 to the north gate to relieve Drone_T02, and Drone_T02 home.",
    'They said "do not send Drone_T04 home". Send Drone_T04 home.',
)


@pytest.mark.parametrize("text", CONTRADICTORY)
def test_an_order_that_demands_and_forbids_the_same_is_asked_back_about(text: str) -> None:
    found = contradiction(WORLD, text)
    assert found is not None
    assert found.first != found.second
    assert found.first in found.question
    assert found.second in found.question


@pytest.mark.parametrize("text", CONSISTENT)
def test_corrections_sequences_exclusions_and_conditions_are_no_contradictions(text: str) -> None:
    assert contradiction(WORLD, text) is None


ASSETS = st.sampled_from([name for name, spec in WORLD.assets.items() if spec.kind != "ugv"])
GATES = st.sampled_from(tuple(WORLD.gates))
GOES = st.sampled_from(
    ("send {a} to {p}", "move {a} to {p}", "{a} to {p}", "{a} goes to {p}", "{a} must go to {p}",
     "have {a} fly to {p}", "please bring {a} to {p}", "{a} is to proceed to {p}")
)  # fmt: skip
BANS = st.sampled_from(
    ("do not send {a} to {p}", "don't move {a} to {p}", "{a} must not go to {p}",
     "never send {a} to {p}", "{a} is not to go to {p}", "under no circumstances move {a} to {p}",
     "please do not bring {a} to {p}", "{a} does not move", "keep {a} where it is",
     "leave {a} in place", "{a} stays put", "do not send {a} anywhere")
)  # fmt: skip
APART = st.sampled_from((". ", "; ", ", and ", ", but ", ".\n"))


@given(asset=ASSETS, place=GATES, both=st.tuples(GOES, BANS).flatmap(st.permutations), apart=APART)
def test_whatever_is_demanded_and_forbidden_in_one_order_is_noticed(
    asset: str, place: str, both: list[str], apart: str
) -> None:
    parts = [each.format(a=asset, p=place) for each in both]
    found = contradiction(WORLD, apart.join(parts))
    assert found is not None
    assert {found.first, found.second} == {*parts}


@given(
    assets=st.lists(ASSETS, min_size=2, max_size=2, unique=True),
    places=st.lists(GATES, min_size=2, max_size=2, unique=True),
    parts=st.tuples(GOES, GOES, BANS),
    apart=APART,
    way=st.sampled_from(("other asset", "other place", "corrected", "in turn", "conditional")),
)
def test_nothing_that_can_be_done_is_taken_for_a_contradiction(
    assets: list[str], places: list[str], parts: tuple[str, str, str], apart: str, way: str
) -> None:
    (asset, other), (place, elsewhere), (goes, again, ban) = assets, places, parts
    first = goes.format(a=asset, p=place)
    match way:
        case "other asset":
            text = f"{first}{apart}{ban.format(a=other, p=place)}"
        case "other place":
            text = f"{first}{apart}do not send {asset} to {elsewhere}"
        case "corrected":
            text = f"{first}. No, I mean, {ban.format(a=asset, p=place)}"
        case "in turn":
            text = f"{first}. Then {again.format(a=asset, p=elsewhere)}"
        case _:
            text = f"{first}. If it rains, {ban.format(a=asset, p=place)}"
    assert contradiction(WORLD, text) is None


@pytest.mark.parametrize("path", sorted((FOLDER / "missions").glob("*.yaml")), ids=lambda p: p.stem)
def test_no_mission_that_is_shipped_is_a_contradiction(path: Path) -> None:
    missions, worlds = load_with_worlds(path, WORLD)
    told = [(worlds[one.world], text) for one in missions.missions for text in one.turns]
    assert [text for world, text in told if contradiction(world, text)] == []


@pytest.mark.parametrize("number", range(written.SITUATIONS))
def test_no_order_as_people_put_it_is_a_contradiction(number: int) -> None:
    there, orders = written.given(number)
    assert [one.text for one in orders if contradiction(there.world, one.text)] == []
