"""Orders that lean on those before are put in full, and shown."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.language.references.conversation import ResolvedOrder, Unclear, leaning_words
from pa_console.language.references.resolution import resolve
from pa_console.language.references.scene import Move, PastMission, after
from tests.language.references.scenes import HOME, asked, read, scene, sent, standing

DRONE = sent("Send Drone_T04 to EastGate.", ("Drone_T04", "Checkpoint", "EastGate"))
ROBOTS = sent(
    "Both robots to NorthGate.",
    ("Robot_T01", "Checkpoint", "NorthGate"),
    ("Robot_T02", "Base", "NorthGate"),
)
ANY = sent("Put a robot at SouthGate.", ("Robot_T01", "Checkpoint", "SouthGate"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("Bring it back.", "Drone_T04 to Checkpoint."),
        ("Bring it home.", "Bring Drone_T04 home."),
        ("Undo that.", "Drone_T04 to Checkpoint."),
        ("No, the west gate.", "Drone_T04 to WestGate."),
        ("Not Drone_T04, the robot at the base.",
         "Robot_T02 to EastGate and Drone_T04 to Checkpoint."),
        ("Same for Ugv_T02.", "Ugv_T02 to EastGate."),
        ("Send Robot_T01 there too.", "Robot_T01 to EastGate."),
        ("Send another vehicle there.", "Ugv_T02 to EastGate."),
        ("The one I sent last reports.", "Drone_T04 reports."),
        ("Let it observe NorthGate.", "Let Drone_T04 observe NorthGate."),
        ("Tell him to go on to the west gate.", "Tell Drone_T04 to go on to WestGate."),
        ("She can come home.", "Drone_T04 can come home."),
        ("Finished over there, now west.", "Drone_T04 to WestGate."),
        ("East is clear. South next, please.", "Drone_T04 to SouthGate."),
        ("On to the north gate.", "Drone_T04 to NorthGate."),
        ("All done, home now.", "Drone_T04 home."),
        ("Repeat that for the south gate with the robot at the base.", "Robot_T02 to SouthGate."),
        ("Do the same at north with Ugv_T02.", "Ugv_T02 to NorthGate."),
        ("Who is at the west gate? Warn him.", "Who is at the west gate? Warn him."),
        ("East is clear now.", "East is clear now."),
        ("Bring the drone home.", "Bring Drone_T04 home."),
        ("Send the same drone to the south gate.", "Send Drone_T04 to SouthGate."),
        ("Send the robot to the south gate.", "Send the robot to the south gate."),
        ("Now the north gate is quiet and the south gate too.",
         "Now the north gate is quiet and the south gate too."),
    ],
)  # fmt: skip
def test_what_was_ordered_last_is_meant(text: str, says: str) -> None:
    assert read(text, scene(*standing(DRONE), past=[DRONE])) == says


def test_they_are_all_that_were_sent_each_back_to_where_it_was() -> None:
    where = scene(*standing(ROBOTS), past=[ROBOTS])
    assert read("They may both come home.", where).split() == (
        ["Robot_T01", "and", "Robot_T02", "may", "come", "home."]
    )
    assert read("Bring them back.", where) == "Robot_T01 to Checkpoint and Robot_T02 home."


def test_the_same_somewhere_else_is_for_another_one() -> None:
    where = scene(*standing(ANY), past=[ANY])
    assert read("Same for north.", where) == "Put a robot at NorthGate."
    named = sent("Robot_T01 to SouthGate.", ("Robot_T01", "Checkpoint", "SouthGate"))
    where = scene(*standing(named), past=[named])
    assert read("Same for north.", where) == "Robot_T02 to NorthGate."


def test_it_is_asked_who_it_is_where_two_were_sent() -> None:
    question = asked("Send it home.", scene(*standing(ROBOTS), past=[ROBOTS]))
    assert (question.words, question.choices) == ("it", ("Robot_T01", "Robot_T02"))


def test_a_name_earlier_in_the_order_is_what_it_means() -> None:
    text = "Drone_T01 has a bad rotor, bring it home."
    assert read(text, scene(*standing(DRONE), past=[DRONE])) == text


@pytest.mark.parametrize(
    "text",
    [
        "It is raining at the east gate.",
        "That was quick, well done.",
        "Send a drone to the west gate.",
        "Close the window, it is draughty.",
        "Knock knock. Who is there?",
        "Water the plants on the second floor.",
        "A lady waits at the west gate, find out what she wants.",
        "A van is coming to the south gate, block it.",
        "Identify him.",
        "Two men are at the west gate, warn them.",
        "There is a lady at the south gate.",
        "Is there somebody at the south gate?",
        "Bring the drone carrier about.",
    ],
)
def test_what_points_at_nothing_stays_as_it_was(text: str) -> None:
    assert read(text, scene(*standing(DRONE), past=[DRONE])) == text


def test_without_anything_before_no_pronoun_means_anybody() -> None:
    assert read("Bring it back.", scene()) == "Bring it back."


def test_what_was_taken_back_is_not_what_there_means() -> None:
    undone = sent("Drone_T04 to Checkpoint.", ("Drone_T04", "EastGate", "Checkpoint"), undid=True)
    assert read("Robot_T01 there instead.", scene(past=[DRONE, undone])) == "Robot_T01 to EastGate."


def test_after_a_correction_back_is_where_it_was_before_all_of_it() -> None:
    first = resolve(scene(*standing(DRONE), past=[DRONE]), "No, the west gate.")
    assert isinstance(first, ResolvedOrder)
    assert first.corrects
    moved = sent(first.text, ("Drone_T04", "EastGate", "WestGate"))
    past = [DRONE, after([DRONE], moved, corrects=True)]
    assert read("Bring it back.", scene(*standing(*past), past=past)) == "Drone_T04 to Checkpoint."


def test_this_one_is_what_is_marked_on_the_screen() -> None:
    where = scene(past=[DRONE], pointer="Ugv_T02")
    assert read("Send this one home.", where) == "Send Ugv_T02 home."
    assert read("Robot_T01 goes to this gate.", scene(pointer="WestGate")) == (
        "Robot_T01 goes to WestGate."
    )


def test_it_is_asked_whether_the_marked_one_is_meant_or_the_last() -> None:
    assert asked("Send it home.", scene(past=[DRONE], pointer="Ugv_T02")).choices == (
        "Ugv_T02",
        "Drone_T04",
    )


def test_it_is_asked_who_goes_on_where_two_went_to_two_places() -> None:
    apart = sent(
        "Robots apart.",
        ("Robot_T01", "Checkpoint", "NorthGate"),
        ("Robot_T02", "Base", "SouthGate"),
    )
    question = asked("Done there, west next.", scene(*standing(apart), past=[apart]))
    assert question.choices == ("Robot_T01 to WestGate", "Robot_T02 to WestGate")


def test_it_is_whom_the_last_question_was_about() -> None:
    status = PastMission("How is Ugv_T02?", (Move("Ugv_T02", "report", before="Checkpoint"),))
    where = scene(*standing(DRONE), past=[DRONE, status])
    assert read("Then send it to the west gate.", where) == "Then send Ugv_T02 to WestGate."
    assert read("And Robot_T01?", where) == "Robot_T01 reports."


def test_the_robot_is_one_that_was_spoken_of_or_it_is_asked_which() -> None:
    where = scene(*standing(DRONE, ROBOTS), past=[DRONE, ROBOTS])
    assert asked("The robot comes home.", where).choices == ("Robot_T01", "Robot_T02")
    assert read("The drone comes home.", where) == "Drone_T04 comes home."
    named = "Robot_T02 is low, bring the robot home."
    assert read(named, where) == "Robot_T02 is low, bring Robot_T02 home."
    assert read("Send the drone home.", scene()) == "Send the drone home."


AGENTS = st.lists(st.sampled_from([*HOME.assets]), min_size=1, max_size=3, unique=True)
KINDS = {"drone": "uav", "vehicle": "ugv", "robot": "robot"}


@settings(deadline=None, max_examples=80)
@given(
    AGENTS,
    st.sampled_from([*HOME.gates]),
    st.sampled_from(["it", "him", "the drone", "that vehicle", "the robot", "the other one"]),
)
def test_a_reference_to_the_last_mission_is_right_or_asked_back(
    agents: list[str], gate: str, said: str
) -> None:
    mission = sent("Go.", *((name, "Checkpoint", gate) for name in agents))
    found = resolve(scene(*standing(mission), past=[mission]), f"Bring {said} home.")
    kind = KINDS.get(said.rsplit(maxsplit=1)[-1])
    kinds = {HOME.assets[name].kind for name in agents}
    if said == "the other one":
        team = [n for n, spec in HOME.assets.items() if {spec.kind} == kinds]
        right = {name for name in team or HOME.assets if name not in agents}
    else:
        right = {name for name in agents if kind in (None, HOME.assets[name].kind)}
    if isinstance(found, Unclear):
        assert len(right) != 1
        assert set(found.choices) <= right
    elif right:
        assert [f"Bring {name} home." for name in right] == [found.text]
    else:
        assert found.text == f"Bring {said} home."


def test_it_is_asked_where_there_is_after_two_places() -> None:
    both = sent(
        "Robots apart.",
        ("Robot_T01", "Checkpoint", "NorthGate"),
        ("Robot_T02", "Base", "SouthGate"),
    )
    question = asked("A drone goes there.", scene(*standing(both), past=[both]))
    assert (question.words, question.choices) == ("there", ("NorthGate", "SouthGate"))


def test_words_whose_meaning_was_not_found_lean_on_the_order_before() -> None:
    last = sent("Ugv_T02 to the west gate.", ("Ugv_T02", "Checkpoint", "WestGate"))
    after = scene(*standing(last), past=(last,))
    assert leaning_words(after, "and the same for its brother") == ("same", "brother")
    assert leaning_words(after, "Robot_T02 to SouthGate.") == ()
    assert leaning_words(scene(), "and the same for its brother") == ()
