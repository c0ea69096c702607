"""The mood of words: an order is never taken for anything else, and what is none is asked about."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.evaluation.jobs import load_missions
from pa_console.language.mood import MoodKind, no_order
from pa_console.resources import data_folder
from pa_training.orders.meaning import orders_nothing
from pa_training.orders.written import drawn_situation, read_writers
from pa_training.situations.worlds import generated_numbers, shipped_missions, shipped_world

WORLD = shipped_world()
MISSIONS = data_folder() / "worlds" / "checkpoint" / "missions"
MOVES = (
    "send {who} to {place}", "move {who} to {place}", "let {who} fly over {place}",
    "have {who} look at {place}", "bring {who} back from {place}", "put {who} at {place}",
)  # fmt: skip
NONE: dict[MoodKind, tuple[str, ...]] = {
    "supposed": ("Imagine we {did}.", "Suppose we {do}.", "What if we {did}?"),
    "wished": ("If only you had {done}.", "I wish you would {do}."),
    "mused": ("I was thinking of {doing}.", "We were going to {do}.", "I might {do} later."),
    "joked": ("Now {do}. Just kidding!",),
    "text_work": ("Translate into Dutch: {do}.", "How do you say “{do}” in Polish?"),
    "reported": ("The driver says: {do}.", "A guard shouted that you should {do}."),
    "questioned": ("Should we {do}?", "Who told you to {do}?", "Did you {do}?"),
    "waiting": (
        "When I say go, {do}.", "Once it rains, {do}.", "{do} as soon as the phone rings.",
        "If the boss agrees, {do}.", "Wait for my signal, then {do}.", "After lunch, {do}.",
    ),
    "needless": ("No need to {do}.", "I never asked you to {do}.", "You don't have to {do}."),
    "prohibited": (
        "Do not {do}.", "Never {do}.", "Under no circumstances {do}.", "You must not {do}.",
        "Please don't {do}.", "Refrain from {doing}.",
    ),
    "past": ("Yesterday we {did}.", "Last night somebody {did}."),
}  # fmt: skip
DOING = {"send": "sending", "move": "moving", "bring": "bringing", "put": "putting"}
DID = {"send": "sent", "move": "moved", "bring": "brought", "put": "put"}
KINDS = [(kind, words) for kind, ways in NONE.items() for words in ways]

orders = st.builds(
    str.format,
    st.sampled_from([move for move in MOVES if move.split()[0] in DID]),
    who=st.sampled_from(["Drone_T04", "the robot at the base", "ugv two", "one of the drones"]),
    place=st.sampled_from(["the east gate", "NorthGate", "the checkpoint"]),
)


@pytest.mark.parametrize("name", ["paper", "field", "descriptions", "dialogues"])
def test_an_order_of_a_mission_set_is_never_taken_for_anything_else(name: str) -> None:
    missions = load_missions(MISSIONS / f"{name}.yaml", WORLD).missions
    texts = [text for case in missions for text in (*case.before, case.command)]
    assert [text for text in texts if no_order(WORLD, text)] == []


@given(orders, st.sampled_from(KINDS))
def test_an_order_under_a_sign_that_makes_it_none_is_asked_back_about(
    order: str, way: tuple[MoodKind, str]
) -> None:
    verb, _, rest = order.partition(" ")
    forms = {"do": order, "doing": f"{DOING[verb]} {rest}", "did": f"{DID[verb]} {rest}"}
    text = way[1].format(**forms, done=forms["did"])
    found = no_order(WORLD, text)
    assert found is not None, text
    assert "Nothing will move." in found.question


@given(orders, st.sampled_from(KINDS))
def test_an_order_beside_one_is_an_order(order: str, way: tuple[MoodKind, str]) -> None:
    kind, words = way
    if kind in ("joked", "text_work"):  # these hold for all that is said
        return
    forms = {"do": "send Drone_T01 home", "doing": "sending Drone_T01 home"}
    none = words.format(**forms, did="sent Drone_T01 home", done="sent Drone_T01 home")
    assert no_order(WORLD, f"{order.capitalize()}. {none}") is None


@pytest.mark.parametrize(
    "text",
    [
        "Why don't you send Drone_T04 to the east gate?",
        "Couldn't we get a drone over the east gate?",
        "Could you have Robot_T01 walk over to the north gate?",
        "Don't leave the west gate empty, send Robot_T01.",
        "Don't let him in, have Ugv_T01 block the lane.",
        "Should Drone_T02 be low, send Drone_T04 there.",
        "If anybody shows up at the north gate, have a drone look at him.",
        "Send Robot_T01 to the north gate, not Robot_T02.",
        "Don't send the drone, send Ugv_T02 to the east gate.",
        "The lookout says there's a van at the east gate that nobody knows.",
        "Drone_T02 was hit by a kite and came down in the bushes.",
        "I meant the other one.",
        "It was supposed to go to the north gate.",
        "All four drones to the east gate at once.",
        "Get Drone_T04 headed home.",
        "If possible, send a robot to the west gate.",
        "Once it is there, bring Ugv_T01 home.",
        "Stay where you are until I call you back.",
    ],
)
def test_what_only_looks_like_one_is_an_order(text: str) -> None:
    assert no_order(WORLD, text) is None


def test_its_question_says_how_it_reads() -> None:
    found = no_order(WORLD, "Do not send Drone_T04 to the east gate.")
    assert found is not None
    assert found.question.startswith("That reads as a prohibition. Nothing will move.")


def test_words_of_writers_who_gave_orders_are_kept() -> None:
    forbidden = generated_numbers(shipped_missions())
    texts, lost = 0, list[str]()
    for writer in read_writers("development").values():
        for each in writer.situations:
            world = drawn_situation(each, forbidden).world
            orders = [one for one in each.first_orders if not orders_nothing(one.meaning)]
            lost += [one.text for one in orders if no_order(world, one.text)]
            texts += len(orders)
    assert len(lost) <= texts / 100, lost
