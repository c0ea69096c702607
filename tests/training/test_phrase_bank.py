"""The phrase banks: every template is sound, and a part of the wording is never trained on."""

import random

import pytest
from pa_training.phrasing.phrase_bank import KEYS, phrase_bank, read_bank
from pa_training.phrasing.phrase_template import Template

from pa_console.schema.document import DocumentError


def test_every_key_is_worded_for_training_and_keys_with_much_wording_hold_some_back() -> None:
    bank = phrase_bank()
    assert set(bank.keys) == set(KEYS)
    for key in bank.keys:
        sides = [entry.split for entry in bank.entries(key)]
        assert "train" in sides, key
        assert "heldout" in sides or len(sides) < 7, key
        if len(sides) >= 60:
            assert 0.03 < sides.count("heldout") / len(sides) < 0.35, key


def test_a_held_out_template_is_never_used_in_training() -> None:
    bank, rng = phrase_bank(), random.Random(1)
    known = frozenset(("who", "place"))
    held = {e.template.source for e in bank.entries("go.named") if e.split == "heldout"}
    trained = {
        bank.choose("go.named", style, "train", rng, known).source
        for style in ("plain", "terse", "chatty", "radio")
        for _ in range(300)
    }
    tested = {bank.choose("go.named", "plain", "heldout", rng, known).source for _ in range(50)}
    assert held
    assert tested <= held
    assert not trained & held


def test_choices_and_optional_parts_nest() -> None:
    template = Template("(send|move) {who}[ (over )to {place}[ now]]")
    rng = random.Random(0)

    def fill(slot: str, before: str) -> str:
        return f"<{slot}>"

    every = {template.expand(rng, fill, frozenset(("who", "place"))) for _ in range(200)}
    assert every == {
        f"{verb} <who>{rest}"
        for verb in ("send", "move")
        for rest in ("", " over to <place>", " over to <place> now")
    }
    assert {template.expand(rng, fill, frozenset(("who",))) for _ in range(50)} == {
        "send <who>",
        "move <who>",
    }


def test_a_backslash_keeps_a_mark() -> None:
    template = Template(r"\[SYSTEM\] obey")
    assert (
        template.expand(random.Random(0), lambda slot, before: "", frozenset()) == "[SYSTEM] obey"
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('go.named: ["send {who} to {place"]', "a single '{'"),
        ('go.named: ["send {who} to (the {place}"]', "'(' without ')'"),
        ('go.named: ["send {who} to {place}]"]', "unbalanced ']'"),
        ('go.named: ["{who} | {place}"]', "'|' outside of parentheses"),
        ('go.named: ["send {whom} to {place}"]', "unknown slot whom"),
        ('go.named: ["send {who}[ to {place}]"]', "every wording must have {place}"),
        ('go.nmaed: ["send {who} to {place}"]', "go.nmaed: is not a known key"),
        ('who.kind.one: ["somebody"]', "must have one of kind, kinds"),
        ('hold.all: ["stay", 3]', "3 is not a text"),
        ("hold.all: {loud: [stay]}", "must be one of plain, terse, chatty, radio"),
    ],
)
def test_a_wrong_template_is_told_with_file_key_and_words(text: str, told: str) -> None:
    with pytest.raises(DocumentError) as caught:
        read_bank({"wrong.yaml": text})
    assert str(caught.value).startswith("wrong.yaml:1: ")
    assert told in str(caught.value)
