"""A text that is a clause in the console's own plain words has one meaning, without a reader."""

import pytest

from pa_console.language.canonical.reading import says_plainly


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("Let another asset relieve Drone_T04.", "asked: relieve Drone_T04 at NorthGate"),
        ("Relieve Drone_T04", "asked: relieve Drone_T04 at NorthGate; "),
        ("Let Robot_T01 relieve Drone_T04.", "asked: Robot_T01 relieves Drone_T04 at NorthGate"),
        ("Send Drone_T04 home.", "asked: Drone_T04 home"),
    ],
)
def test_what_is_said_plainly_is_read_for_sure(text: str, asked: str) -> None:
    assert says_plainly(text, asked)


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("Let another asset relieve Drone_T04.", "asked: relieve Drone_T01 at NorthGate"),
        ("Let another asset relieve Drone_T04.", "asked: Robot_T01 relieves Drone_T04"),
        ("Let Robot_T01 relieve Drone_T04.", "asked: relieve Drone_T04 at NorthGate"),
        ("Relieve Drone_T04 at EastGate.", "asked: relieve Drone_T04 at NorthGate"),
        ("Relieve Drone_T04.", "asked: relieve Drone_T04 at NorthGate; Drone_T04 home"),
        ("Do not relieve Drone_T04.", "asked: relieve Drone_T04 at NorthGate"),
        ("Relieve Drone_T04.", "asked: have a word with it"),
        ("Send Drone_T04 there.", "asked: Drone_T04 to NorthGate"),
    ],
)
def test_every_other_text_is_left_to_the_readers(text: str, asked: str) -> None:
    assert not says_plainly(text, asked)
