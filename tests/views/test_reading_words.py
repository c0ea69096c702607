"""What an order was read as is told in plain words, and every reading in words of its own."""

import re

import pytest

from pa_console.language.canonical.reading import plain_reading
from tests.written import SITUATIONS, given

NAME = re.compile(r"[A-Z][a-z]+(?:_?[A-Z][a-zA-Z]*)?[0-9]*|\b\d+\b")
UNDER = "if Drone_T01 low: Drone_T01 home; 2 vehicles to Junction, else: nothing"
TOLD = "if Drone_T01 is low on battery, send Drone_T01 home and send 2 ground vehicles to Junction"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("1 drone to EastGate", "send 1 drone to EastGate"),
        ("all from WestGate home", "send everybody from WestGate home"),
        ("look at EastGate", "look at EastGate"),
        ("1 robot warn at unknown place", "let 1 ground robot warn whoever is at an unknown place"),
        ("warn at EastGate", "warn whoever is at EastGate"),
        ("1 robot identify person at G", "let 1 ground robot identify the person at G"),
        ("cover EastGate by 1 robot", "let 1 ground robot guard EastGate"),
        ("cover Ugv_T01 at EastGate", "give EastGate a guard for Ugv_T01"),
        ("cover A_1 at G by 1 drone", "let 1 drone guard G for A_1"),
        ("all free robots to EastGate", "send every free ground robot to EastGate"),
        ("A_1, A_2, A_3 hold; others stay", "let A_1, A_2 and A_3 stay put; all others stay"),
        ("set rules aside, block EastGate", "close the lane at EastGate (setting rules aside)"),
        ("warn at G without identification", "warn whoever is at G without identification"),
        ("hold with noncombatants", "stay put (though noncombatants are there)"),
        ("if no asset free: hold, else: report", "if no asset is free, stay put, otherwise report"),
        (UNDER, f"{TOLD}, otherwise do nothing"),
        (f"{UNDER}; now: Drone_T01: low, alone, so", f"{TOLD}, otherwise do nothing"),
        (f"{UNDER}; now: x, not so; others stay", f"{TOLD}, otherwise do nothing; all others stay"),
        ("something that nobody taught", "something that nobody taught"),
    ],
)  # fmt: skip
def test_a_reading_is_told_in_plain_words(words: str, told: str) -> None:
    assert plain_reading(f"asked: {words}") == told


@pytest.mark.parametrize("number", range(0, SITUATIONS, 4))
def test_every_name_and_number_is_told_and_how_a_condition_stands_is_not(number: int) -> None:
    for one in given(number).orders:
        told = plain_reading(one.order.asked)
        assert sorted(NAME.findall(told)) == sorted(NAME.findall(one.meaning))
        assert not re.search(r"; now:|else:|^if [^,]+:|stand down|asked", told)


@pytest.mark.parametrize("number", range(0, SITUATIONS, 4))
def test_readings_that_differ_are_told_apart(number: int) -> None:
    readings = {one.order.asked for one in given(number).orders}
    assert len({plain_reading(asked) for asked in readings}) == len(readings)
