"""Patrols in words: who, where, in which order, how often, how long; and what is none."""

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.orders.patrols import Patrol, PatrolLimits, least_s, legs_of, read_patrol
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.scene import ReferenceScene
from tests.shipped import home

SCENE = ReferenceScene(home(), SimulatedFleet.start(home()).picture())
LIMITS = PatrolLimits(stay_s=10.0, most_laps=5)
GATES = ("NorthGate", "EastGate", "SouthGate", "WestGate")


@pytest.mark.parametrize(
    ("text", "patrol"),
    [
        ("Patrol west, north and east with Drone_T04, twice.",
         Patrol(("WestGate", "NorthGate", "EastGate"), 2, 10.0, "Drone_T04")),
        ("Have a robot walk the gates.", Patrol(GATES, 1, 10.0, kind="robot")),
        ("patrol all gates in any order with Ugv_T02",
         Patrol(GATES, 1, 10.0, "Ugv_T02", any_order=True)),
        ("Let Robot_T01 do two rounds of the east gate and the north gate.",
         Patrol(("EastGate", "NorthGate"), 2, 10.0, "Robot_T01")),
        ("Robot_T01 should patrol north and south once, with a 2 min stop at each point.",
         Patrol(("NorthGate", "SouthGate"), 1, 120.0, "Robot_T01")),
        ("can robot 2 make the tour of all gates, begin with the west, clockwise, one time please",
         Patrol(("WestGate", "NorthGate", "EastGate", "SouthGate"), 1, 10.0, "Robot_T02")),
        ("one round of the gates with Drone_T04, dwell one minute at each gate",
         Patrol(GATES, 1, 60.0, "Drone_T04")),
    ],
)  # fmt: skip
def test_a_patrol_is_read(text: str, patrol: Patrol) -> None:
    assert read_patrol(SCENE, text, LIMITS) == patrol


@pytest.mark.parametrize(
    "text",
    [
        "The robot at the base walks up to the checkpoint.",
        "Have the robot nearest the checkpoint walk over to the east gate.",
        "Send Drone_T04 to patrol the east gate.",
        "Send Drone_T04 to the north gate and Robot_T01 to the east gate.",
    ],
)
def test_what_is_no_patrol_is_left_to_the_models(text: str) -> None:
    assert read_patrol(SCENE, text, LIMITS) is None


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("Patrol north and south until told otherwise.", "at most 5 (patrol_laps)"),
        ("Patrol north and south with Drone_T04 9 times.", "9 laps are too many"),
        ("Patrol north and south with Drone_T04 and Drone_T01.", "one asset goes on a patrol"),
        ("Patrol north and the quarry with Drone_T04 and south.", "“quarry” is not understood"),
    ],
)
def test_what_is_not_clear_about_a_patrol_is_asked_back(text: str, told: str) -> None:
    found = read_patrol(SCENE, text, LIMITS)
    assert isinstance(found, Unclear)
    assert told in found.question


def test_the_nearest_place_comes_first_in_any_order() -> None:
    patrol = Patrol(GATES, 2, 0.0, "Robot_T02", any_order=True)
    legs = legs_of(patrol, SCENE, "Robot_T02")
    assert sorted(legs) == sorted(GATES * 2)
    assert legs[:4] == legs[4:]
    first = min(GATES, key=lambda gate: SCENE.distance_m("Robot_T02", gate))
    assert legs[0] == first


def test_a_patrol_takes_at_least_its_ways_and_its_stays() -> None:
    once = Patrol(("NorthGate", "SouthGate"), 1, 0.0, "Robot_T01")
    staying = Patrol(("NorthGate", "SouthGate"), 1, 30.0, "Robot_T01")
    assert least_s(once, SCENE) > 0.0
    assert least_s(staying, SCENE) == least_s(once, SCENE) + 30.0
