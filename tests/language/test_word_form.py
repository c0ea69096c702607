"""One form of words is written, matched and chosen by what there is to say."""

import re

import pytest

from pa_console.language.canonical.word_form import WordForm

FORM = WordForm("({who} relieves|relieve) {guard}[ at {place}]")
SLOTS = {"who": r"(?P<who>\w+)", "guard": r"(?P<guard>\w+)", "place": r"(?P<place>\w+)"}


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"guard": "A"}, "relieve A"),
        ({"guard": "A", "who": "B"}, "B relieves A"),
        ({"guard": "A", "who": "B", "place": "G"}, "B relieves A at G"),
    ],
)
def test_what_is_written_is_matched_with_the_same_in_its_slots(
    said: dict[str, str], words: str
) -> None:
    assert FORM.write(said) == words
    found = re.fullmatch(FORM.pattern(SLOTS), words)
    assert found is not None
    assert {slot: one for slot, one in found.groupdict().items() if one} == said


def test_what_is_needed_and_not_said_is_taken_from_the_defaults() -> None:
    assert not FORM.fits({"who": "B"})
    assert FORM.write({"who": "B"}, {"guard": "somebody"}) == "B relieves somebody"
    with pytest.raises(KeyError):
        FORM.write({"who": "B"})


def test_the_way_that_says_most_is_taken_also_within_another() -> None:
    form = WordForm("identify ([{thing} ]at {gate}|{track})")
    assert form.write({"gate": "G"}) == "identify at G"
    assert form.write({"gate": "G", "thing": "person"}) == "identify person at G"
    assert form.write({"track": "T at G"}) == "identify T at G"


def test_an_expression_keeps_the_groups_of_the_form() -> None:
    assert (
        FORM.pattern({"who": "a", "guard": "b", "place": "c"}) == "(a relieves|relieve) b( at c)?"
    )
