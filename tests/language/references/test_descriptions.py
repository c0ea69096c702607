"""Descriptions are found in the picture, and never guessed where two things fit."""

from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.language.references.conversation import ResolvedOrder, Unclear
from pa_console.language.references.resolution import chosen, resolve
from pa_console.schema.incident import FailAsset, Incident, PlaceAsset, SetBattery, SpawnTrack
from tests.language.references.scenes import HOME, asked, read, scene

QUIET = scene()
KINDS = {"drone": "uav", "vehicle": "ugv", "robot": "robot"}
placed = st.builds(
    PlaceAsset, asset=st.sampled_from([*HOME.assets]), frame=st.sampled_from([*HOME.frames])
)
failed = st.builds(FailAsset, asset=st.sampled_from([*HOME.assets]))
setups = st.lists(placed | failed, max_size=5)


@pytest.mark.parametrize(
    ("text", "setup", "says"),
    [
        ("Robot_T02 to the gate nobody covers.", [FailAsset(asset="Drone_T01")], "WestGate"),
        ("Robot_T02 to the gate guarded by a vehicle.", [], "EastGate"),
        ("Robot_T02 to the gate where Drone_T02 is.", [], "NorthGate"),
        ("Robot_T02 to the same gate as Drone_T03.", [], "SouthGate"),
        ("Robot_T02 to the gate furthest from the base.", [], "WestGate"),
        ("Drone_T04 to the gate where the car is.",
         [SpawnTrack(gate="NorthGate", distance_m=50.0)], "NorthGate"),
        ("The robot at the checkpoint comes home.", [], "Robot_T01"),
        ("The drone with the emptiest battery comes home.",
         [SetBattery(asset="Drone_T02", percent=40)], "Drone_T02"),
        ("The drone that doesn't guard a gate comes home.", [], "Drone_T04"),
        ("Put a drone at every gate.", [],
         "Put a drone at NorthGate, EastGate, SouthGate and WestGate."),
        ("One robot to each of the four gates, please.", [], "NorthGate, EastGate, SouthGate and"),
        ("Put the robot at the base at the north gate.", [], "Put Robot_T02 at NorthGate"),
        ("Ugv_T01 stays, the other vehicle comes home.", [], "Ugv_T02 comes"),
        ("Everyone except the drones reports.", [], "Ugv_T01, Ugv_T02, Robot_T01 and Robot_T02"),
        ("Both robots report.", [], "Robot_T01 and Robot_T02"),
        ("Whoever is closest to the south gate, go there.",
         [PlaceAsset(asset="Robot_T02", frame="NorthGate")], "to SouthGate"),
    ],
)  # fmt: skip
def test_a_description_becomes_the_name(text: str, setup: list[Incident], says: str) -> None:
    assert says in read(text, scene(*setup))


@pytest.mark.parametrize(
    "text",
    [
        "Send a drone to the east gate.",
        "Move everyone who is free to the east gate.",
        "All four drones to the north gate.",
        "Put the robot at the south gate.",
        "Report from all the gates.",
        "Station the drone at the north gate.",
        "Is the gate guard out of coffee?",
        "The sign reads \"take the robot at the base home\". Robot_T01 goes to the north gate.",
    ],
)  # fmt: skip
def test_what_describes_nothing_stays_as_it_was_typed(text: str) -> None:
    assert read(text, QUIET) == text


def test_what_was_understood_stands_beside_the_words() -> None:
    found = resolve(QUIET, "Robot_T02 to the gate guarded by a ugv.")
    assert isinstance(found, ResolvedOrder)
    assert found.meanings == (("the gate guarded by a ugv", "EastGate"),)


@settings(deadline=None, max_examples=60)
@given(setups, st.integers(0, 3))
def test_a_gate_by_its_guards_is_named_only_where_no_other_fits(
    setup: list[Incident], number: int
) -> None:
    where = scene(*setup)
    words = f"the gate with {['no guard', 'only one guard', 'two guards', 'three guards'][number]}"
    fit = [g for g, cover in where.picture.gates.items() if len(cover.by) == number]
    found = resolve(where, f"Send Robot_T02 to {words}.")
    if len(fit) == 1:
        assert isinstance(found, ResolvedOrder)
        assert found.text == f"Send Robot_T02 to {fit[0]}."
    else:
        assert isinstance(found, Unclear)
        assert found.choices == tuple(fit or HOME.gates)


@settings(deadline=None, max_examples=60)
@given(setups, st.sampled_from([*KINDS]), st.sampled_from([*HOME.frames]))
def test_an_asset_by_its_place_is_named_only_where_no_other_fits(
    setup: list[Incident], kind: str, place: str
) -> None:
    where = scene(*setup)
    here = [a for a in where.picture.assets.values() if a.kind == KINDS[kind] and a.post == place]
    fit = [a.id for a in here if a.available] or [a.id for a in here]
    found = resolve(where, f"The {kind} at {place} reports.")
    if len(fit) == 1:
        assert isinstance(found, ResolvedOrder)
        down = not where.picture.assets[fit[0]].available
        assert found.text == f"{fit[0]}{f' at {place}' if down else ''} reports."
    else:
        assert isinstance(found, Unclear)
        assert set(found.choices) == set(fit)


@settings(deadline=None, max_examples=40)
@given(st.permutations([20.0, 45.0, 70.0, 95.0]))
def test_a_superlative_is_the_best(percents: list[float]) -> None:
    drones = [name for name, spec in HOME.assets.items() if spec.kind == "uav"]
    pairs = zip(drones, percents, strict=True)
    where = scene(*(SetBattery(asset=name, percent=value) for name, value in pairs))
    best = max(drones, key=lambda name: where.picture.assets[name].battery_pct)
    assert read("The drone with the fullest battery reports.", where) == f"{best} reports."


WORDS = [
    "the",
    "a",
    "both",
    "all",
    "whoever",
    "everyone",
    "that",
    "which",
    "with",
    "only",
    "one",
    "two",
    "gate",
    "gates",
    "drone",
    "robots",
    "vehicle",
    "guard",
    "guards",
    "nobody",
    "on",
    "it",
    "nearest",
    "to",
    "base",
    "battery",
    "fullest",
    "is",
    "not",
    "at",
    "other",
    "but",
    "where",
    "and",
    ",",
    ".",
    "?",
    "'s",
    "Drone_T04",
    "EastGate",
    "there",
    "I",
    "sent",
    "last",
    "if",
    "so",
    "low",
    "silent",
    "has",
    "failed",
    "them",
    "undo",
    "same",
    "for",
    "no",
    "instead",
    "back",
]


@settings(deadline=None, max_examples=300)
@given(st.lists(st.sampled_from(WORDS), max_size=14).map(" ".join))
def test_any_words_are_read_the_same_again_and_name_only_what_there_is(text: str) -> None:
    found = resolve(QUIET, text)
    assert found == resolve(QUIET, text)
    known = {*HOME.assets, *HOME.frames}
    if isinstance(found, Unclear):
        assert not any(name in text for name in set(found.choices) - known if "_T" in name)
    else:
        read_names = {word.strip(".,") for word in found.text.split() if "_T" in word}
        assert {name for name in read_names if name.isidentifier()} <= known


@pytest.mark.parametrize(
    ("answer", "means"),
    [
        ("EastGate", "EastGate"),
        ("the east one", "EastGate"),
        ("east, please", "EastGate"),
        ("the one guarded by a ugv", "EastGate"),
        ("north or east", ""),
        ("you decide", ""),
    ],
)
def test_an_answer_means_one_of_the_choices_or_none(answer: str, means: str) -> None:
    assert chosen(QUIET, answer, ("NorthGate", "EastGate")) == means


def test_an_answer_may_name_who_is_in_one_of_the_orders_offered() -> None:
    orders = ("Robot_T01 to EastGate", "Robot_T02 to EastGate")
    assert chosen(QUIET, "robot two", orders) == orders[1]
    assert not chosen(QUIET, "both", orders)


def test_an_answer_may_be_a_number_or_a_kind() -> None:
    who = ("Drone_T04", "Robot_T01")
    pairs = product(("4", "number 4", "the drone"), ("Drone_T04",))
    assert all(chosen(QUIET, answer, who) == name for answer, name in pairs)


def test_a_place_is_asked_back_about_with_what_fits() -> None:
    question = asked("Put Robot_T02 at the gate with only one guard.", QUIET)
    assert question.words == "the gate with only one guard"
    assert question.choices == HOME.gates


@pytest.mark.parametrize("text", ["Send someone to the gate.", "A drone over the gate, please."])
def test_the_gate_is_asked_for_where_it_may_be_any(text: str) -> None:
    unclear = asked(text, scene())
    assert (unclear.question, unclear.choices) == ("Which gate is meant?", tuple(HOME.gates))
    assert "SouthGate" in read_with(text, unclear.words, "SouthGate")


@pytest.mark.parametrize(
    "text", ["Send a robot to the north gate.", "Guard the gate at the base.", "All gates, report."]
)
def test_a_gate_that_is_named_is_not_asked_for(text: str) -> None:
    assert resolve(scene(), text) == ResolvedOrder(text)


def test_the_gate_without_a_guard_is_meant_where_there_is_one() -> None:
    bare = scene(FailAsset(asset="Ugv_T01"))
    assert isinstance(resolve(bare, "Send someone to the gate."), ResolvedOrder)


def read_with(text: str, said: str, means: str) -> str:
    found = resolve(scene(), text, {said: means})
    assert isinstance(found, ResolvedOrder)
    return found.text
