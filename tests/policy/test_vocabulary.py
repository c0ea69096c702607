"""The vocabulary of retrieval: as installed, and refused with a place when it is wrong."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.policy.related_words import (
    Groups,
    Spelling,
    Vocabulary,
    default_vocabulary,
    load_vocabulary,
    ngrams,
    words_of,
)
from pa_console.schema.document import DocumentError

WORDS = ("watch", "watches", "battery", "gate")
LIGHTS = Vocabulary(name="lights", groups={"light": ("lamp", "torch"), "fire": ("torch",)})


def test_the_installed_vocabulary_names_no_rule_and_no_place_of_one_world() -> None:
    words = {word for words in default_vocabulary().groups.values() for word in words}
    assert all(words_of(word) == [word] for word in words)
    assert not any(digit in word for word in words for digit in "0123456789")


@pytest.mark.parametrize(
    ("text", "field", "line"),
    [
        ("name: v\ngroups:\n  a: [gate, of]\nignored: [of]\n", "groups.a.1", 3),
        ("name: v\ngroups:\n  a:\n    - north gate\n", "groups.a.0", 4),
        ("name: v\ngroups:\n  a: [gate, off]\n", "groups.a.1", 3),
        ("name: v\nwords: []\n", "words", 2),
    ],
)
def test_a_wrong_vocabulary_is_refused_with_its_line_and_field(
    tmp_path: Path, text: str, field: str, line: int
) -> None:
    path = tmp_path / "words.yaml"
    path.write_text(text)
    with pytest.raises(DocumentError) as caught:
        load_vocabulary(path)
    assert (caught.value.field, caught.value.line) == (field, line)


def test_a_word_fits_every_group_it_is_in_and_one_spelt_alike_fits_less() -> None:
    groups = Groups(LIGHTS)
    assert groups.fit("torch").tolist() == [1.0, 1.0]
    assert groups.fit("lamp").tolist() == [1.0, 0.0]
    light, fire = groups.fit("lamps")
    assert 0.6 <= light < 1.0
    assert fire == 0.0
    assert not groups.fit("gate").any()


@given(st.one_of(st.sampled_from(WORDS), st.text(min_size=1, max_size=12)))
def test_a_word_is_most_like_itself(word: str) -> None:
    alike = Spelling(WORDS).likeness(word)
    assert ((alike >= 0.0) & (alike <= 1.0)).all()
    if word in WORDS:
        assert alike.argmax() == WORDS.index(word)
        assert alike.max() == 1.0


def test_an_ending_and_a_slip_are_more_alike_than_another_word() -> None:
    spelling = Spelling(WORDS)
    for word, place in (("watching", 0), ("batery", 2), ("gtate", 3)):
        assert spelling.likeness(word).argmax() in (place, place + 1)


def test_names_are_taken_apart_as_they_are_put_together() -> None:
    assert words_of("Drone_T01 to EastGate, NOW") == ["drone", "t01", "to", "east", "gate", "now"]
    assert words_of("Следи за 東門") == ["следи", "за", "東門"]
    assert words_of("") == []


def test_the_ends_of_a_word_are_part_of_its_ngrams() -> None:
    assert len(ngrams("gate", 3, 3)) == 4
    assert not set(ngrams("gate", 3, 3)) & set(ngrams("agatea", 3, 3)) - {"gat", "ate"}
