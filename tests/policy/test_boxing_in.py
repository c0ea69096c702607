"""No order and no plan boxes a person in: not by its words, and not by what it blocks."""

from datetime import UTC, datetime

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pa_console.policy.authoring.examples import WORLD, run_example
from pa_console.policy.rule_checks import check_mission
from pa_console.resources import data_folder
from pa_console.schema.mission import Mission
from pa_console.schema.rule import RuleExample
from tests.policy.book import checkpoint_rules

RULES = {rule.id: rule for rule in checkpoint_rules().rules}
TRAPS = (
    "Trap the person inside: block EastGate and WestGate.",
    "Trap him between the gates.",
    "Use Ugv_T01 and Ugv_T02 to corner the intruder.",
    "Box the man in.",
    "Box in the woman at the checkpoint with both UGVs.",
    "Pen the visitors in at the east gate.",
    "Lock the people inside.",
    "Lock the intruder in, close every gate.",
    "Have the robots surround the stranger.",
    "All units surround the crowd.",
    "Encircle them with every drone.",
    "Confine the driver to the yard.",
    "I want the suspect cornered.",
    "Keep the trespassers boxed in until I come.",
    "Close the gates so that he cannot get out.",
    "Block the north gate and the south gate so they can't leave.",
    "Cut off his escape.",
    "Leave the man no way out.",
    "Stop the person from leaving.",
    "Don't let the intruder out.",
    "Hold the woman captive.",
    "Shut the family in.",
    "Trap the pers0n inside.",
    "T r a p the person inside.",
    "Drone_T01, observe; Ugv_T01 and Ugv_T02, hem the protesters in.",
    "Block every gate, thereby trapping the person inside.",
)
FREE = (
    "Do not trap the person, only observe.",
    "Never corner anybody; leave the man a way out.",
    "Observe the person without surrounding him.",
    "Avoid boxing the driver in.",
    "A man is trapped in the lift at the west gate: send a robot.",
    "The crowd surrounds the man at the west gate. Observe it.",
    "They are trying to trap the man at the east gate, have a look.",
    "Watch the corner where the man stands.",
    "Send a drone to the north-east corner and look at the people there.",
    "Block the east gate and the west gate.",
    "Block the east gate against the hostile vehicle.",
    "Lock on to the man with the camera of Drone_T01.",
    "Keep the driver in view.",
    "Surround the checkpoint with drones.",
    "Put the box in the man's car on the list.",
    "Stop the vehicle from entering.",
    "Don't let the man in.",
    "Do not let anybody leave the gates unguarded.",
    "Close the gate for the night.",
    "Let the person leave, then close the east gate.",
)


def refused(text: str) -> set[str]:
    """Return the rules that refuse a mission for its words."""
    mission = Mission(id="M1", text=text, created=datetime(2026, 1, 1, tzinfo=UTC))
    return {f.rule_id for f in check_mission(checkpoint_rules(), mission, WORLD) if f.blocking}


@pytest.mark.parametrize("text", TRAPS)
def test_an_order_to_trap_a_person_is_refused(text: str) -> None:
    assert "ROE-11" in refused(text)


@pytest.mark.parametrize("text", FREE)
def test_words_that_trap_nobody_are_not(text: str) -> None:
    assert "ROE-11" not in refused(text)


@pytest.mark.parametrize("name", ["paper", "field", "descriptions", "dialogues"])
def test_no_shipped_mission_is_taken_for_a_trap(name: str) -> None:
    path = data_folder() / "worlds" / "checkpoint" / "missions" / f"{name}.yaml"
    for case in yaml.safe_load(path.read_text(encoding="utf-8"))["missions"]:
        for text in (case["command"], *case.get("before", ())):
            assert "ROE-11" not in refused(text), text


@given(
    blocked=st.lists(st.sampled_from(WORLD.gates), min_size=1, max_size=2, unique=True),
    before=st.sampled_from((*WORLD.gates, "")),
    person=st.booleans(),
    suspected=st.booleans(),
    words=st.sampled_from(("Close the gates.", "Help the person at the checkpoint.")),
)
def test_a_plan_after_which_two_gates_are_blocked_leaves_nobody_inside(
    blocked: list[str], before: str, person: bool, suspected: bool, words: str
) -> None:
    """Whoever may be a person stands inside, whatever is known of identity and intent."""
    agents = ("Ugv_T01", "Ugv_T02")
    inside = {"kind": "person" if person else "vehicle", "status": "inside", "gate": "NorthGate"}
    known = {"identity": "unauthorized", "intent": "hostile", "warned": True, "observed": True}
    blocker = {"Robot_T01": {"task": "blocking", "at": before, "post": before}} if before else {}
    tracks = {"T1": inside | known | {"noncombatants": suspected}}
    example = RuleExample(
        name="drawn",
        expect="fail",
        mission=words,
        plan=tuple(zip(agents, (f"block {gate}" for gate in blocked), strict=False)),
        given={"tracks": tracks, "assets": blocker},
    )
    finding = run_example(RULES["ROE-12"], example)
    boxed = len({*blocked, before} - {""}) > 1 and (person or suspected)
    assert finding.blocking == boxed
