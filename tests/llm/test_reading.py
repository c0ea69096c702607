"""What a model says was asked is read back as it was meant, clause by clause."""

import math
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.language.canonical.order import Ask, Reading, Who
from pa_console.language.canonical.reading import asked_words, read_asked, read_reason
from pa_console.language.name_linking import link_names
from pa_console.llm.backend import Chance, confidence
from pa_console.llm.roles.grammar import READ, begun_reason
from pa_console.llm.roles.planner import Planner
from pa_console.llm.roles.prompts import Prompt
from pa_training.situations.worlds import shipped_world
from tests import written
from tests.llm import site
from tests.scripted import ScriptedEngine, plan


@pytest.mark.parametrize("number", range(0, written.SITUATIONS, 4))
@pytest.mark.parametrize("facts", ["hold", "Free drone: Drone_T04, guards stay"])
def test_what_was_asked_is_told_apart_from_the_facts_that_decide(number: int, facts: str) -> None:
    for one in written.given(number).orders:
        reason = f"{one.order.asked}; {facts}"
        begun = asked_words(reason)
        assert begun == f"{one.order.asked}; "
        assert read_reason(begun + "other facts") == read_reason(reason)


@pytest.mark.parametrize("by", ["", " by 1 drone"])
def test_a_gate_is_covered_for_whom_it_has_lost(by: str) -> None:
    bare, lost = read_asked(f"asked: cover G{by}"), read_asked(f"asked: cover A_1 at G{by}")
    assert bare is not None
    assert lost is not None
    (one,), (other,) = bare.asks, lost.asks
    assert (other.task, other.place, other.leaving) == ("cover", "G", "A_1")
    assert replace(other, leaving="", words="") == replace(one, words="")


def test_a_reason_that_does_not_say_what_was_asked_has_no_such_words() -> None:
    assert not asked_words("the gate needs a guard; Drone_T04 is free")


@given(st.text(max_size=80))
def test_any_text_has_a_reading_or_none(text: str) -> None:
    found = read_asked(f"asked: {text}")
    assert found is not None
    assert read_reason(text) is None or text.startswith("asked: ")


@pytest.mark.parametrize(
    "order",
    [
        "use force at EastGate",
        "chase beyond the perimeter",
        "leave all gates without guard",
        "set rules aside, 1 drone to EastGate",
        "Ugv_T01 block EastGate without warning",
        "1 robot warn person at EastGate without identification",
    ],
)
def test_what_no_order_may_have_is_told_apart(order: str) -> None:
    reading = read_asked(f"asked: {order}")
    assert reading is not None
    assert [ask.task for ask in reading.asks] == ["refused"]


def test_the_facts_of_a_reason_are_no_part_of_the_order() -> None:
    reason = "asked: 1 drone look at EastGate; others stay; Free drone: Drone_T04"
    asked = Ask("look", Who(kind="uav"), "EastGate", words="1 drone look at EastGate")
    assert read_reason(reason) == Reading((asked,), others_stay=True)


@pytest.mark.parametrize(("so", "place"), [("so", "EastGate"), ("not so", "WestGate")])
def test_of_a_condition_the_case_that_applies_counts(so: str, place: str) -> None:
    reading = read_asked(
        "asked: if drone free: 1 drone to EastGate, else: 1 drone to WestGate; "
        f"now: Free drone: Drone_T04, {so}"
    )
    assert reading is not None
    assert [ask.place for ask in reading.asks] == [place]


def test_a_clause_in_other_words_is_kept_and_means_nothing() -> None:
    reading = read_asked("asked: dance at EastGate tonight; 1 drone to EastGate")
    assert reading is not None
    assert not reading.readable
    assert [ask.task for ask in reading.asks] == ["unreadable", "go"]


READINGS = (
    "asked: 1 drone to EastGate",
    "asked: hold; report at EastGate",
    "asked: identify vehicle at EastGate; Ugv_T01, Ugv_T02 home; others stay",
    "asked: if Ugv_T01 low: Ugv_T01 home; hold, else: 1 drone to EastGate; report; "
    "now: Ugv_T01: free, not so",
    "asked: if track at EastGate: hold, else: nothing; now: At EastGate: no track, so; others stay",
)
FACTS = ("Free drone: Drone_T04", "At EastGate: no track", "EastGate: nobody (WF-03), hold", "hold")


@pytest.mark.parametrize("facts", FACTS)
@pytest.mark.parametrize("said", READINGS)
def test_a_reason_is_known_to_have_said_what_was_asked(said: str, facts: str) -> None:
    begins, whole = '{"reason": "', f'{{"reason": "{said}; {facts}", "actions": ['
    found = re.search(READ, whole)
    assert found is not None
    assert asked_words(begun_reason(whole[: found.end()])).rstrip("; ") == said
    for end in range(len(begins + said) + 1):
        assert re.search(READ, whole[:end]) is None


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


CHANCES = st.lists(st.tuples(st.integers(0, 40), st.floats(-9.0, 0.0)), min_size=1, max_size=12)
ASKED = "asked: 1 drone home; "
ANSWER = plan(("Drone_T04", "return_to_base"), reason=f"{ASKED}Free drone: Drone_T04")


@given(CHANCES, st.integers(0, 40))
def test_words_that_follow_each_other_are_as_likely_as_both(chances: list[Chance], at: int) -> None:
    text = "".join(chr(0x4E00 + n) for n in range(41))
    first, second = confidence(chances, text, text[:at]), confidence(chances, text, text[at:])
    whole = confidence(chances, text, text)
    assert whole is not None
    assert second is not None
    assert whole == pytest.approx((first or 0.0 if at else 1.0) * second, abs=1e-4)


def test_what_the_model_was_given_no_choice_about_is_certain() -> None:
    assert confidence([(0, -1.0), (9, -1.0)], "one, two, three", "two") == 1.0


@pytest.mark.parametrize(("chances", "words"), [([], "one"), ([(0, -1.0)], ""), ([(0, -1.0)], "x")])
def test_without_chances_or_without_the_words_nothing_is_said(
    chances: list[Chance], words: str
) -> None:
    assert confidence(chances, "one, two", words) is None


@pytest.mark.parametrize(
    ("at", "sure"), [(ANSWER.index("drone"), 0.25), (ANSWER.index("Free"), 1.0)]
)
async def test_a_planner_is_as_sure_as_of_what_it_says_was_asked(at: int, sure: float) -> None:
    engine = ScriptedEngine([ANSWER], chances=[(at, math.log(0.25))])
    proposal = await Planner(engine.engine()).plan(Prompt("s", "u"), "grammar")
    assert proposal.confidence == sure
