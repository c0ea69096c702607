"""Words of order: steps, what is waited for, and the *then* that parts nothing."""

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.orders.order_steps import ReadSteps, read_steps, unkept_steps
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.scene import ReferenceScene
from tests.shipped import home, mission_sets

SCENE = ReferenceScene(home(), SimulatedFleet.start(home()).picture())


@pytest.mark.parametrize(
    ("text", "steps"),
    [
        ("First Robot_T01 to the north gate, then bring Drone_T02 home.",
         ("Robot_T01 to NorthGate.", "Bring Drone_T02 home.")),
        ("Send Drone_T04 to the east gate. After that send Ugv_T02 to the south gate.",
         ("Send Drone_T04 to EastGate.", "Send Ugv_T02 to SouthGate.")),
        ("robot 1 to the west gate first, afterwards robot 2 to the north gate",
         ("Robot_T01 to WestGate.", "Robot_T02 to NorthGate.")),
        ("Send Robot_T01 to the south gate. Once it is there, bring Ugv_T02 home.",
         ("Send Robot_T01 to SouthGate.", "Bring Ugv_T02 home.")),
        ("Send Robot_T01 to the north gate and bring Drone_T02 home once it is there.",
         ("Send Robot_T01 to NorthGate.", "Bring Drone_T02 home.")),
        ("Robot_T01 to the north gate; not before Robot_T01 is in place may Ugv_T01 leave.",
         ("Robot_T01 to NorthGate.", "Ugv_T01 leave.")),
        ("Take Robot_T01 to the east gate and then to the south gate.",
         ("Take Robot_T01 to EastGate.", "Send it to SouthGate.")),
        ("Have Drone_T04 look at the south gate, then return to base.",
         ("Have Drone_T04 look at SouthGate.", "Drone_T04 return to base.")),
        ("Robot 1 goes to the east gate. After Robot_T01 has reached it, Drone_T04 goes home.",
         ("Robot_T01 goes to EastGate.", "Drone_T04 goes home.")),
        ("I want Drone_T04 at the south gate. Afterwards it goes back to base.",
         ("I want Drone_T04 at SouthGate.", "It goes back to base.")),
        ("Drone_T04 goes to south first and only when its on station Drone_T03 comes home",
         ("Drone_T04 goes to south.", "Drone_T03 comes home.")),
        ("1) Drone_T04 observe north gate 2) Robot_T01 to north gate",
         ("Drone_T04 observe NorthGate.", "Robot_T01 to NorthGate.")),
        ("Send a drone to the north gate. Next, send a robot to the west gate. Then all report.",
         ("Send a drone to NorthGate.", "Send a robot to WestGate.", "All report.")),
    ],
)  # fmt: skip
def test_words_of_order_part_the_steps(text: str, steps: tuple[str, ...]) -> None:
    assert read_steps(SCENE, text) == ReadSteps(steps)
    assert unkept_steps(SCENE, text)


@pytest.mark.parametrize(
    "text",
    [
        "If the east gate has no guard, then send a drone there.",
        "Send the drone that is next to the checkpoint to the east gate.",
        "Send the first free robot to the south gate.",
        "Then again, send Drone_T04 to the east gate.",
        "When Drone_T04 gets low, then bring it home.",
        "Is Drone_T03 low? Then bring it home and put Drone_T04 there.",
        "A car stopped at the gate, then drove off. Send a drone to the east gate.",
        "Bring Robot_T02 to the checkpoint before it starts.",
        "Send Drone_T04 to the east gate at once.",
    ],
)
def test_what_is_no_order_of_steps_is_not_parted(text: str) -> None:
    assert read_steps(SCENE, text) is None
    assert unkept_steps(SCENE, text) == ()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("Bring Ugv_T02 home, but not before Robot_T01 is at the east gate.", "sends Robot_T01"),
        ("Once Robot_T02 is in place, Ugv_T01 leaves for the base.", "sends Robot_T02"),
        ("If a car comes, send Drone_T04 north, then Robot_T01 to the north gate, then report.",
         "both a condition and steps"),
        ("First Drone_T04 to the north gate, then Robot_T01 home, then the weather is fine.",
         "Step 3"),
    ],
)  # fmt: skip
def test_what_is_not_clear_about_the_steps_is_asked_back(text: str, told: str) -> None:
    found = read_steps(SCENE, text)
    assert isinstance(found, Unclear)
    assert told in found.question


def test_what_has_to_be_there_first_can_be_chosen() -> None:
    text = "Bring Ugv_T02 home, but not before Robot_T01 is at the east gate."
    found = read_steps(SCENE, text)
    assert isinstance(found, Unclear)
    (choice,) = found.choices
    assert read_steps(SCENE, choice) == ReadSteps(("Robot_T01 to EastGate.", "Bring Ugv_T02 home."))


def test_the_papers_missions_are_no_orders_in_steps() -> None:
    (paper,) = [found for found, _ in mission_sets() if found.name == "paper"]
    assert len(paper.missions) == 10
    texts = [case.command for case in paper.missions]
    assert [text for text in texts if read_steps(SCENE, text) is not None] == []


def test_a_name_before_then_is_of_the_next_step() -> None:
    text = "Drone_T04 take over NorthGate, Drone_T02 then return to base."
    steps = ("Drone_T04 take over NorthGate.", "Drone_T02 return to base.")
    assert read_steps(SCENE, text) == ReadSteps(steps)
