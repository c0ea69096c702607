"""Which texts are questions to the console; an order is never taken for one."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.language.questions import read_question
from pa_console.schema.events.intake import QuestionTopic
from pa_console.schema.incident import FailAsset
from tests.language.references.scenes import HOME, scene
from tests.shipped import missions

SCENE = scene()
DRONES = ("Drone_T01", "Drone_T02", "Drone_T03", "Drone_T04")
ROBOTS = ("Robot_T01", "Robot_T02")
QUESTIONS: dict[str, tuple[QuestionTopic, tuple[str, ...]]] = {
    "Why?": ("plan", ()),
    "how come": ("plan", ()),
    "Why not?": ("plan", ()),
    "why that plan": ("plan", ()),
    "Explain.": ("plan", ()),
    "Why was it refused?": ("plan", ()),
    "Why can't I approve it?": ("plan", ()),
    "why does the judge object": ("plan", ()),
    "why did nothing happen": ("plan", ()),
    "why that drone": ("asset", DRONES),
    "Why drone four?": ("asset", ("Drone_T04",)),
    "why did you send Drone_T04": ("asset", ("Drone_T04",)),
    "Why is drone 4 going to the north gate?": ("asset", ("Drone_T04",)),
    "why was it Drone_T04": ("asset", ("Drone_T04",)),
    "why not the robot": ("other_asset", ROBOTS),
    "Why didn't you send the robot?": ("other_asset", ROBOTS),
    "why did you not send robot 2 to the east gate?": ("other_asset", ("Robot_T02",)),
    "why was Robot_T01 not chosen": ("other_asset", ("Robot_T01",)),
    "Why Drone_T04 and not Ugv_T02?": ("other_asset", ("Ugv_T02",)),
    "why not the robot at the base": ("other_asset", ("Robot_T02",)),
    "What speaks against the robot?": ("other_asset", ROBOTS),
    "Why is the north gate uncovered?": ("gate", ("NorthGate",)),
    "why is nobody at the north gate": ("gate", ("NorthGate",)),
    "Why has the west gate no guard?": ("gate", ("WestGate",)),
    "why did you leave the east gate unguarded": ("gate", ("EastGate",)),
    "What would you do instead?": ("alternatives", ()),
    "any other option?": ("alternatives", ()),
    "what else could we do": ("alternatives", ()),
    "is there another way": ("alternatives", ()),
    "Is there another way to do it?": ("alternatives", ()),
    "show me the alternatives": ("alternatives", ()),
    "How else could we do that?": ("alternatives", ()),
    "Can it be done differently?": ("alternatives", ()),
    "What would you suggest instead of that?": ("alternatives", ()),
}
ORDERS = (
    "Send the robot instead",
    "Not Drone_T04, the robot instead",
    "Why is nobody at the north gate? Send someone.",
    "Why? Send Drone_T04 home.",
    "Why not send the robot?",
    "Why don't you send the robot?",
    "Why don't you stop?",
    "Why don't we use Robot_T01 for that?",
    "Why not go to the east gate with Drone_T04?",
    "I wonder why Drone_T01 is not at the east gate, move it there",
    "Instead of Drone_T04 send Robot_T02 to the east gate.",
    "What if you sent the robot to the east gate instead?",
    "Do it another way: Robot_T01 to EastGate",
    "No other option, send Ugv_T02 to the west gate",
    "Use another drone",
    "Another robot there, please",
    "Find out why the truck is at the west gate",
    "Ask the person at the west gate why he is here",
    "Explain to the visitor at the east gate that he has to leave",
    "Show me the north gate",
    "Take another way home",
    "Plan the other gate instead",
    "Send a drone to see what else is there",
    "Whatever else you do, keep the north gate covered",
    "Why the delay? Get a drone to EastGate",
    "How about Robot_T01 to the east gate",
    "What would you do about the truck at the west gate?",
    "Have Drone_T04 look why nobody is at the north gate",
)


def found(text: str) -> tuple[QuestionTopic, tuple[str, ...]] | None:
    read = read_question(SCENE, text)
    return (read.topic, read.subjects) if read is not None else None


@pytest.mark.parametrize("text", QUESTIONS)
def test_a_question_is_read_with_who_or_which_gate_is_meant(text: str) -> None:
    assert found(text) == QUESTIONS[text]


@pytest.mark.parametrize("text", ORDERS)
def test_an_order_with_words_of_a_question_is_an_order(text: str) -> None:
    assert found(text) is None


OPENINGS = ("", "And ", "But ", "ok, ", "So ", "please ", "Tell me, ", "well ")
ENDINGS = ("", "?", ".", "?!", "??", ", please", " then?", " exactly?")


@given(
    st.sampled_from(OPENINGS),
    st.sampled_from(sorted(QUESTIONS)),
    st.sampled_from(ENDINGS),
    st.sampled_from((str, str.lower, str.upper)),
)
def test_case_stops_and_small_words_change_nothing(
    opening: str, text: str, ending: str, case: type[str]
) -> None:
    said = opening + text.rstrip("?.") + ending
    assert found(case(said)) == QUESTIONS[text]


MISSIONS = tuple(case.command for case, _ in missions().values())


def test_no_mission_that_is_shipped_is_a_question() -> None:
    assert len(MISSIONS) > 50
    assert not [text for text in MISSIONS if found(text) is not None]


@settings(max_examples=1500, deadline=None)
@given(
    st.sampled_from(sorted(QUESTIONS)),
    st.sampled_from((*ORDERS[:2], *MISSIONS)),
    st.sampled_from((" ", "? ", ". ", ", ", " and ", ": ", "; ", " - ")),
    st.booleans(),
)
def test_an_order_beside_a_question_is_never_swallowed(
    text: str, order: str, joint: str, first: bool
) -> None:
    # Without any stop, *Why not* and *both robots to the south gate* are one question.
    then = joint if joint.strip() else "? "
    said = f"{order.rstrip('.')}{joint}{text}" if first else f"{text.rstrip('?.')}{then}{order}"
    assert found(said) is None


WORDS = (
    *("why", "not", "send", "the", "robot", "instead", "Drone_T04", "to", "EastGate", "is"),
    *("nobody", "at", "you", "did", "what", "else", "would", "do", "another", "way", "home"),
    *("stop", "hold", "go", "and", "?", ",", "it", "that", "how", "come", "any", "option"),
)


@settings(max_examples=3000, deadline=None)
@given(st.lists(st.sampled_from(WORDS), max_size=9), st.sampled_from((" ", ", ", "? ", " and ")))
def test_whatever_is_a_question_is_none_with_an_order_beside_it(
    words: list[str], joint: str
) -> None:
    text = " ".join(words)
    if found(text) is not None:
        assert found(f"{text}{joint}send Drone_T04 home") is None
        assert found(f"Send Drone_T04 home{joint}{text}") is None


def test_the_gate_that_alone_has_no_guard_needs_no_name() -> None:
    where = scene(FailAsset(asset="Drone_T02"))
    read = read_question(where, "Why is the gate uncovered?")
    assert read is not None
    assert read.subjects == ("NorthGate",)
    assert read_question(SCENE, "Why is the gate uncovered?") is None


def test_what_is_marked_on_the_map_is_this_one() -> None:
    read = read_question(scene(pointer="Ugv_T02"), "Why not this one?")
    assert read is not None
    assert read.subjects == ("Ugv_T02",)
    assert found("Why not this one?") is None


def test_long_talk_is_no_question() -> None:
    assert found("why " * 200) is None
    assert set(HOME.assets) >= {*DRONES, *ROBOTS}
