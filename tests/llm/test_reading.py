"""What a model says was asked is read back as it was meant, clause by clause."""

import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.language.canonical.order import Ask, Reading, Who
from pa_console.language.canonical.reading import asked_words, read_asked, read_reason
from pa_console.llm.roles.grammar import READ, begun_reason
from tests import written


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
