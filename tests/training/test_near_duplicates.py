"""The near-duplicate filter: the same sentence goes however it is dressed, another one stays."""

from pathlib import Path

import pytest
import yaml

from pa_console.evaluation.jobs import load_missions
from pa_training.orders.near_duplicates import THRESHOLD, NearDuplicates, masked
from pa_training.situations.worlds import shipped_missions, shipped_world

MISSIONS = (
    "Have the robot at the plaza check the hatch of bay two before lunch",
    "Bring Drone_T01 to EastGate because the bus with the choir is early",
    "A goat has climbed the roof of WestGate, somebody should film it for the newspaper",
)
SAME = (
    (0, "have the robot at the plaza check the hatch of bay three before lunch"),
    (0, "Hve the robot at teh plaza check the hacth of bay two befor lunch"),
    (
        0,
        "Good evening team, this is control. "
        "Have the robot at the plaza check the hatch of bay two before lunch, thanks a lot",
    ),
    (0, "Before lunch, have the robot at the plaza check the hatch of bay two"),
    (0, "Have the robot at the plaza check the door of bay two before lunch"),
    (1, "bring drone 4 to the north gate because the bus with the choir is early"),
    (1, "BRING DRONE_T02 TO WESTGATE BECAUSE THE BUS WITH THE CHOIR IS EARLY"),
    (1, "because the bus with the choir is early bring Drone_T03 to southgate"),
    (1, "Send Drone_T01 to EastGate because the bus with the choir is early"),
    (1, "Bring Drone_T01 to EastGate because the van with the choir is early"),
    (2, "A goat has climbed the roof of NorthGate, somebody should film it for the newspaper"),
    (2, "a goaat haz climbd the roof of westgate sombody shud film it for the newspaper"),
    (
        2,
        "ok listen. "
        "A goat has climbed the roof of WestGate, somebody should film it for the newspaper. Over.",
    ),
    (2, "Somebody should film it for the newspaper, a goat has climbed the roof of WestGate"),
)
OTHER = (
    (0, "I want the hatch of bay two looked at by the plaza's robot, and before we eat"),
    (0, "Have the drone at the plaza watch the fence of yard two after supper"),
    (0, "Let the plaza robot see whether bay two is shut, lunch is at noon"),
    (1, "The choir's bus comes too soon, so I need Drone_T01 at EastGate"),
    (1, "Bring Drone_T01 to EastGate"),
    (1, "Bring Drone_T01 home because its battery is nearly empty"),
    (1, "Move Drone_T01 over to EastGate since the fog is getting thicker"),
    (2, "Somebody go and take pictures of the goat on top of WestGate, the paper wants them"),
    (2, "A van has stopped on the lane of WestGate, somebody should look at it for the log"),
    (2, "The roof of WestGate has an animal on it; get a camera there"),
)


@pytest.fixture
def made_up(tmp_path: Path) -> NearDuplicates:
    file = tmp_path / "made_up.yaml"
    cases = [
        {"id": f"m{number}", "category": "made up", "command": command}
        for number, command in enumerate(MISSIONS)
    ]
    file.write_text(yaml.safe_dump({"name": "made_up", "missions": cases}), encoding="utf-8")
    return NearDuplicates([file])


@pytest.mark.parametrize(("mission", "text"), SAME)
def test_the_same_sentence_is_dropped(made_up: NearDuplicates, mission: int, text: str) -> None:
    assert made_up.similarity([text])[0, mission] >= THRESHOLD + 5
    assert made_up.keep([text]) == [False]


@pytest.mark.parametrize(("mission", "text"), OTHER)
def test_another_sentence_stays(made_up: NearDuplicates, mission: int, text: str) -> None:
    assert made_up.similarity([text])[0, mission] <= THRESHOLD - 5
    assert made_up.keep([text]) == [True]


def test_names_of_a_world_are_masked_in_every_form() -> None:
    world = shipped_world()
    same = {
        masked(text, world)
        for text in (
            "Drone_T04 to EastGate",
            "drone four to the east gate",
            "UAV 1 to gate north",
            "Ugv Tango Zero Two to West",
        )
    }
    assert same == {"asset to gate"}


def test_the_shipped_missions_themselves_are_dropped() -> None:
    files = shipped_missions()
    texts = [c.command for file in files for c in load_missions(file, shipped_world()).missions]
    kept = NearDuplicates(files).keep(texts).count(True)
    assert (kept, len(texts) > 0) == (0, True)
