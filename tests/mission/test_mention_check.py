"""What an order names has to be in its reading, and what its reading names in the order."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pa_console.language.mention_check import MentionCheck, check_mentions
from pa_console.schema.plan import Action, Plan
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import Site
from tests.attacks.readings import measure

NOTHING = Plan(reason="", actions=())


def check(site: Site, text: str, asked: str, plan: Plan = NOTHING) -> MentionCheck:
    picture = Checkpoint(site.world, 0).picture()
    return check_mentions(site.world, picture, text, f"asked: {asked}" if asked else "", plan)


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("Send one drone to the east gate.", "1 drone to EastGate"),
        ("east gate, one drone", "1 drone to EastGate"),
        ("uav four, look at the w gate", "Drone_T04 look at WestGate"),
        ("Bring Drone_T01 home.", "Drone_T01 home"),
        ("Drone 2 is low, replace it.", "relieve Drone_T02 at NorthGate"),
        ("The east gate is quiet. Send a drone to the north gate.", "1 drone to NorthGate"),
        ('The note says "all to base". Block the south gate.', "block SouthGate"),
        ("If a car is at the west gate, warn it.", "if vehicle at WestGate: warn at WestGate, "
         "else: nothing; now: At WestGate: no track, not so"),
        ("Send two drones to the north gate, not the south gate.", "2 drones to NorthGate"),
        ("All units hold.", "all hold"),
        ("South gate has lost its drone, see to the coverage there.", "cover SouthGate"),
        ("Restore coverage at the south gate.", "cover SouthGate"),
        ("Cover every gate that has no guard, so the east gate.", "any to EastGate"),
        ("Send Drone_T04 to the east gate and stay there.", "Drone_T04 to EastGate"),
        ("Robot_T01, go to the south gate and stay with it.", "Robot_T01 to SouthGate"),
        ("West gate, West gate, this is Watch. One drone to the east gate. Out.",
         "1 drone to EastGate"),
        ("Robot_T01 to the north gate. No wait, Robot_T02.", "Robot_T02 to NorthGate"),
        ("Robot one to north... correction, south gate, I say again, south gate",
         "Robot_T01 to SouthGate"),
        ("Send a robot to the north gate, but not Robot_T01", "1 robot to NorthGate"),
        ("Robot_T01 to the main base", "Robot_T01 home"),
        ("Drone four, a quick look-down on the west gate.", "Drone_T04 look at WestGate"),
        ("what's the west gate lookin like", "report at WestGate"),
        ("Robot one, don't you move.", "Robot_T01 hold"),
        ("the checkpoint wagon across the south gate to block it", "Ugv_T02 block SouthGate"),
        ("If West is uncovered, Drone four to West.", "if Drone_T01 down: Drone_T04 to WestGate, "
         "else: nothing; now: Drone_T01: alone, not so"),
        ("leave the west drone exactly where it is", "Drone_T01 hold"),
        ("the drone over the checkpoint goes to the east gate", "Drone_T04 to EastGate"),
        ('Send "Robot_T01" to the "north gate".', "Robot_T01 to NorthGate"),
        ("Robot 1 to the checkpoint, drone 4 to the north gate",
         "Robot_T01 to Checkpoint, Drone_T04 to NorthGate"),
    ],
)  # fmt: skip
def test_a_right_reading_has_no_gap(site: Site, text: str, asked: str) -> None:
    assert check(site, text, asked).gaps == ()


@pytest.mark.parametrize(
    ("text", "asked", "gap"),
    [
        ("Send all assets to base.", "all free to WestGate", "not accounted for: base"),
        ("Robot_T01 to the moon base", "Robot_T01 home", "not accounted for: moon base"),
        ("van one is at the west gate, stop it", "Ugv_T01 to WestGate", "words: Ugv_T01"),
        ("UGV BATT 9 PCT, get it home", "Ugv_T09 home", "not in the order's words: Ugv_T09"),
        (
            'The flyer says "Drone_T01 and Drone_T02 return to base". Drone_T04 reports.',
            "Drone_T01, Drone_T02 home",
            "not in the order's words: Drone_T01",
        ),
        ('A note reads "all drones to the west gate". Hold.', "all drones to WestGate", "WestGate"),
        ("drone 3 % at the north gate, home", "Drone_T03 home", "words: Drone_T03"),
        ("Robot_T01 to the north gate. No wait, Robot_T02.", "Robot_T01 to NorthGate", "Robot_T02"),
        ("Robot one to north... correction, south gate", "Robot_T01 to NorthGate", "SouthGate"),
        (
            "Drone_T04 to the north gate. Actually, also Robot_T01 to the south gate.",
            "Robot_T01 to SouthGate",
            "NorthGate",
        ),
        ("A drone to the west gate, but not Drone_T03.", "Drone_T03 to WestGate", "Drone_T03"),
        ("Send a drone to the east gate.", "1 drone to WestGate", "EastGate"),
        (
            "If a car is at West, Drone four to West.",
            "if Drone_T01 down: Drone_T04 to WestGate, "
            "else: nothing; now: Drone_T01: alone, not so",
            "words: Drone_T01",
        ),
        ("A drone to the west gate.", "Drone_T01 to WestGate", "words: Drone_T01"),
        ("The drone at the west gate goes home.", "Drone_T02 home", "words: Drone_T02"),
        ("What is at the west gate goes home.", "Drone_T01 home", "words: Drone_T01"),
        ("One more on every gate, start with the east gate.", "any to EastGate", "every gate"),
        ("Drone_T04, this is Watch. Go to the east gate.", "Drone_T01 to EastGate", "Drone_T04"),
        ("Send a drone to the east gate.", "1 robot to EastGate", "not accounted for: drone"),
        ("Send two drones to the east gate.", "1 drone to EastGate", "not accounted for: 2 drones"),
        ("Send Drone_T04 to EastGate.", "Drone_T01 to EastGate", "Drone_T01"),
        ("Send Drone_T04 to EastGate.", "Drone_T04 hold", "not accounted for: Send"),
        ("Hold Drone_T04.", "Drone_T04 to EastGate", "not in the order's words: EastGate"),
        ("Send a drone to the east gate and hold everybody else.", "1 drone to EastGate", "hold"),
        ("Send a drone to the east gate, the others stay.", "1 drone to EastGate", "stay"),
        ("Look at the east gate.", "block EastGate", "not in the order's words: block EastGate"),
        (
            "Send a drone to the east gate.",
            "all drones to EastGate",
            "not in the order's words: all",
        ),
    ],
)
def test_a_wrong_reading_is_told_by_what_does_not_match(
    site: Site, text: str, asked: str, gap: str
) -> None:
    assert any(gap.lower() in said.lower() for said in check(site, text, asked).gaps)


def test_a_time_that_the_plan_does_not_keep_is_a_gap(site: Site) -> None:
    plan = Plan(reason="", actions=(Action(agent="Drone_T04", command="move_to EastGate"),))
    text, asked = "iIn one minute send Drone_T04 to the east gate.", "Drone_T04 to EastGate"
    assert check(site, text, asked, plan).gaps == ("time not kept: one minute",)
    assert check(site, text.removeprefix("iIn one minute "), asked, plan).gaps == ()


def test_who_is_sent_from_a_place_does_not_account_for_an_order_to_go_there(site: Site) -> None:
    plan = Plan(reason="", actions=(Action(agent="Robot_T02", command="move_to WestGate"),))
    found = check(site, "Send all assets to base.", "all free to WestGate", plan)
    assert "not accounted for: base" in found.gaps


def test_every_mention_is_listed_with_whether_it_is_accounted_for(site: Site) -> None:
    found = check(site, "Send Drone_T04 to base.", "Drone_T04 to WestGate")
    listed = {(one.mention.sort, one.mention.words): one.accounted for one in found.mentions}
    assert listed["asset", "Drone_T04"]
    assert not listed["place", "base"]


def test_what_no_plan_can_do_now_is_accounted_for_by_saying_so(site: Site) -> None:
    picture = Checkpoint(site.world, 0).picture()
    text, asked = "Drone_T04 to EastGate and Ugv_T09 to NorthGate.", "asked: Drone_T04 to EastGate"
    lines = ("Ugv_T09 to NorthGate: no such asset",)
    assert check_mentions(site.world, picture, text, asked, NOTHING).gaps
    assert check_mentions(site.world, picture, text, asked, NOTHING, lines).gaps == ()


def test_without_a_reading_the_plan_alone_is_looked_at(site: Site) -> None:
    plan = Plan(reason="why", actions=(Action(agent="Drone_T04", command="move_to WestGate"),))
    assert check(site, "Send Drone_T04 to the west gate.", "", plan).gaps == ()
    assert check(site, "Send Drone_T04 to the east gate.", "", plan).gaps != ()


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=st.text(alphabet=st.characters(categories=("So", "Po", "Nd", "Lo")), max_size=40))
def test_a_text_without_a_word_for_anything_moves_nobody(site: Site, text: str) -> None:
    plan = Plan(reason="", actions=(Action(agent="Drone_T04", command="move_to WestGate"),))
    assert check(site, text, "1 drone to WestGate", plan).gaps


def test_few_right_readings_are_objected_to_and_most_wrong_ones_are() -> None:
    rates = measure(5)
    assert rates.right > 100
    assert rates.alarms <= 0.3 * rates.right
    assert rates.noticed.total() >= 0.85 * rates.tried.total()
