"""Entity linking: however operators say a name, the model reads it as the world writes it."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.language.name_linking import link_names
from pa_training.situations.worlds import shipped_world
from tests.llm import site

WORLD = shipped_world()
NAMES = (*WORLD.assets, *WORLD.frames, *WORLD.zones)


@pytest.mark.parametrize(
    ("said", "read"),
    [
        ("send uav four to the north gate", "send Drone_T04 to NorthGate"),
        ("drones 1 and 3, West Gate", "Drone_T01 and Drone_T03, WestGate"),
        ("Drone_T02 and T03 hold", "Drone_T02 and Drone_T03 hold"),
        ("T03 is dead", "Drone_T03 is dead"),
        ("north, east and the south gates", "NorthGate, EastGate and SouthGate"),
        ("the north and the east gate", "NorthGate and EastGate"),
        ("the W gate, GATE EAST, the southern gate", "WestGate, EastGate, SouthGate"),
        ("wset gte", "WestGate"),
        ("Ugv Tango Zero Two", "Ugv_T02"),
        ("drone#2 robot no. 1 UAV-3", "Drone_T02 Robot_T01 Drone_T03"),
        ("FRAME_NorthGate", "NorthGate"),
        ("drone eleven", "Drone_T11"),
        ("to the the north gate", "to NorthGate"),
    ],
)
def test_a_name_in_other_words_is_linked(said: str, read: str) -> None:
    assert link_names(WORLD, said) == read


def test_a_teams_own_word_becomes_the_word_for_its_kind() -> None:
    assert link_names(site.WORLD, "any hawk to the hill gate") == "any drone to HillGate"
    assert link_names(site.WORLD, "an hawk or 2 mules") == "a drone or 2 ugvs"


@pytest.mark.parametrize(
    "said",
    [
        "one robot to the gate",
        "the last gate of the best gates",
        "a vehicle 2 km away",
        "two drones. 3 vehicles",
        "T01 holds",
        "T02",
        "go north",
        "the gate NorthGate",
    ],
)
def test_what_can_mean_several_things_is_left_to_the_model(said: str) -> None:
    assert link_names(WORLD, said) == said


@given(st.lists(st.sampled_from((*NAMES, "to", "and", "two", "the", "drone", "1", ",", "gate"))))
def test_linking_again_changes_nothing(words: list[str]) -> None:
    once = link_names(WORLD, " ".join(words))
    assert link_names(WORLD, once) == once


@given(st.sampled_from(NAMES), st.sampled_from(("{}", "at {}.", "«{}»", "({})", "{}?")))
def test_a_name_as_it_is_stays(name: str, around: str) -> None:
    assert link_names(WORLD, around.format(name)) == around.format(name)


@given(st.text(max_size=200))
def test_only_names_come_in(text: str) -> None:
    new = set(re.findall(r"\w+", link_names(WORLD, text))) - set(re.findall(r"\w+", text))
    known = set(NAMES) | {"drone", "drones", "ugv", "ugvs", "robot", "robots"}
    assert all(any(name in word for name in known) or "_T" in word for word in new)
