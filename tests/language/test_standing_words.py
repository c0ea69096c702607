"""What is read as a standing order, and what is asked about or left alone."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.orders.standing_orders import ReadStanding, read_standing
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.scene import ReferenceScene
from pa_console.policy.standing_conditions import StandingCondition
from pa_console.resources import data_folder
from pa_console.schema.mission import StandingOrder
from pa_console.sim.worlds.world_file import load_world

WORLD = load_world(data_folder() / "worlds" / "checkpoint" / "world.yaml")
SCENE = ReferenceScene(WORLD, SimulatedFleet.start(WORLD, 0).picture())
UAV, LOW = "it.kind == 'uav'", "it.battery_pct < 20.0"
BARE = "!it.covered && size(it.unsure) == 0"
READ = {
    "Whenever a drone is below 20 %, relieve it.": (f"{UAV} && {LOW}", "Relieve {it}."),
    "each time one of the drones drops under twenty percent battery: bring it home": (
        f"{UAV} && {LOW}", "Bring {it} home."),
    "If any asset is ever low on battery, then relieve it": ("it.low_battery", "Relieve {it}."),
    "Whenever uav 4's battery is less than 20 %, send a drone to its post": (
        f"id == 'Drone_T04' && {LOW}", "Send a drone to {place}."),
    "Whenever you see that a gate has no guard, send the nearest drone there.": (
        BARE, "Send the nearest drone to {it}."),
    "Every time a gate has no guard, send the nearest drone there.": (
        BARE, "Send the nearest drone to {it}."),
    "Send Drone_T04 to the west gate whenever the west gate is uncovered": (
        f"id == 'WestGate' && {BARE}", "Send Drone_T04 to WestGate."),
    "Whenever an unknown vehicle comes to the east gate, send a drone to look at it.": (
        "it.identity == 'unknown' && it.kind == 'vehicle' && it.gate == 'EastGate' && "
        "it.status != 'leaving'", "Send a drone to look at {it}."),
    "Please, whenever a robot at WestGate fails, fill the gap at its gate.": (
        "it.kind == 'robot' && (it.post == 'WestGate' || it.at == 'WestGate') && "
        "it.status == 'failed'", "Fill the gap at {place}."),
    "Whenever a vehicle ignores a warning, block that gate": (
        "it.kind == 'vehicle' && it.defiant", "Block {place}."),
}  # fmt: skip
ORDERS = (
    "Send a drone to the east gate.",
    "Whenever it suits, send a drone to the east gate.",
    "get robot two down to south um whenever it's ready",
    "Every time I hear Drone_T01 hum I think of bees.",
    "If Drone_T01 is low, relieve it.",
    "Has anybody ever seen Drone_T03?",
    "if it were up to me nothing would ever stand empty, so let Drone_T04 fill in at WestGate",
)
ASKED = (
    "Whenever the moon is full, relieve a drone.",
    "Whenever the drone is below 20 %, relieve it.",
    "Whenever a drone is below 20, relieve it.",
    "Whenever a drone is below 120 %, relieve it.",
    "Whenever a drone is below 20 % and the moon is full, relieve it.",
    "Whenever a drone is not below 20 %, relieve it.",
    "Whenever a drone is below 20 %",
    "Whenever a drone is below 20 %, relieve {it}.",
    "Whenever a gate has no guard, use its guard.",
    "Relieve it whenever.",
)


@pytest.mark.parametrize("text", READ)
def test_condition_and_order_are_read(text: str) -> None:
    read = read_standing(SCENE, text)
    assert isinstance(read, ReadStanding)
    assert (read.condition.cel, read.order) == READ[text]
    assert not read.unasked


@pytest.mark.parametrize("text", ORDERS)
def test_an_order_for_now_is_none(text: str) -> None:
    assert read_standing(SCENE, text) is None


@pytest.mark.parametrize("text", ASKED)
def test_what_is_not_understood_is_asked(text: str) -> None:
    assert isinstance(read_standing(SCENE, text), Unclear)


def test_who_is_asked_and_how_often_at_most_is_said_in_the_order() -> None:
    text = "Whenever a gate has no guard, send a drone there without asking, at most twice an hour."
    read = read_standing(SCENE, text)
    assert isinstance(read, ReadStanding)
    assert (read.unasked, read.most_an_hour) == (True, 2)
    assert read.order == "Send a drone to {it}."


WORDS = sorted({word for text in (*READ, *ASKED) for word in text.split()})


@settings(max_examples=300, deadline=None)
@given(st.lists(st.sampled_from(WORDS), max_size=12))
def test_whatever_is_said_it_compiles_is_asked_about_or_is_none(said: list[str]) -> None:
    read = read_standing(SCENE, f"Whenever {' '.join(said)}")
    if not isinstance(read, ReadStanding):
        return
    order = StandingOrder(
        id="S1", text="t", each=read.condition.subject_kind, condition=read.condition.cel,
        words=read.condition.words, order=read.order,
    )  # fmt: skip
    holding = StandingCondition(order, WORLD).holding(SCENE.picture)
    assert all(value in (True, False, None) for value in holding.values())
