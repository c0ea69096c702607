"""The hash of a rule set follows what it says, not how it is written; so does the comparison."""

import random
from typing import Any

import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.policy.authoring.differences import compare_rules, word_changes
from pa_console.policy.rule_seal import content_sha256
from pa_console.schema.document import Document
from pa_console.schema.rule import RuleSet
from tests.policy.sets import WORDS, as_set, edited, rule_sets, shuffled, texts

FEW = settings(max_examples=40, deadline=None)


@FEW
@given(rule_sets(), st.randoms(use_true_random=False), st.booleans(), st.integers(20, 200))
def test_the_hash_does_not_depend_on_how_the_file_is_written(
    value: dict[str, Any], rng: random.Random, flow: bool, width: int
) -> None:
    text = yaml.safe_dump(
        shuffled(value, rng), sort_keys=False, default_flow_style=flow, width=width
    )
    back = Document("rules.yaml", f"# a comment\n{text}\n").parse(RuleSet)
    assert content_sha256(back) == content_sha256(as_set(value))
    assert compare_rules(as_set(value), back) == ()


@FEW
@given(rule_sets(), st.data())
def test_a_change_of_any_text_changes_the_hash_and_is_found(
    value: dict[str, Any], data: st.DataObject
) -> None:
    place = data.draw(st.sampled_from(texts(value)))
    before, after = as_set(value), as_set(edited(value, place))
    assert content_sha256(before) != content_sha256(after)
    [change] = compare_rules(before, after)
    parts = {"rules": "rule", "workflows": "workflow"}
    assert (change.part, change.kind) == (parts.get(str(place[0]), "set"), "changed")
    if change.part != "set":
        assert change.id == value[str(place[0])][place[1]]["id"]


@FEW
@given(rule_sets(), rule_sets())
def test_sets_are_equal_exactly_when_their_hashes_are(a: dict[str, Any], b: dict[str, Any]) -> None:
    mixed = {**a, "rules": b["rules"]} if "workflows" not in a else a
    for other in (a, b, mixed):
        same = content_sha256(as_set(a)) == content_sha256(as_set(other))
        assert same == (compare_rules(as_set(a), as_set(other)) == ())


@FEW
@given(WORDS, WORDS)
def test_word_changes_joined_give_both_texts(before: str, after: str) -> None:
    stretches = word_changes(before, after)
    assert "".join(words for kind, words in stretches if kind != "added") == before
    assert "".join(words for kind, words in stretches if kind != "removed") == after


def rules(*ids: str, **fields: object) -> RuleSet:
    """Return a set of rules with these ids, the first of them with `fields`."""
    base = {"domain": "ROE", "priority": "high", "text": "Be safe.", "check": "c", "message": "m"}
    entries = [{"id": name, **base, **(fields if name == ids[0] else {})} for name in ids]
    return as_set({"name": "own", "rules": entries})


def test_added_removed_changed_and_moved_rules_are_told_apart() -> None:
    before = rules("ROE-01", "ROE-02", "ROE-03", "ROE-04")
    after = rules("ROE-01", "ROE-04", "ROE-03", "ROE-05", text="Be very safe.")
    kinds = {change.id: change.kind for change in compare_rules(before, after)}
    assert kinds["ROE-01"] == "changed"
    assert kinds["ROE-02"] == "removed"
    assert kinds["ROE-05"] == "added"
    assert sorted(kinds.get(name, "") for name in ("ROE-03", "ROE-04")) == ["", "moved"]


def test_an_example_that_is_put_in_does_not_change_those_after_it() -> None:
    old = {"name": "old", "expect": "pass"}
    before = rules("ROE-01", examples=[old])
    after = rules("ROE-01", examples=[{"name": "new", "expect": "fail"}, old])
    [change] = compare_rules(before, after)
    assert {field.field for field in change.fields} == {"examples.new.name", "examples.new.expect"}


def test_the_order_of_a_workflow_s_ends_and_of_examples_counts() -> None:
    one, two = ({"name": name, "expect": "pass"} for name in "ab")
    before, after = rules("ROE-01", examples=[one, two]), rules("ROE-01", examples=[two, one])
    assert content_sha256(before) != content_sha256(after)
    assert [field.field for field in compare_rules(before, after)[0].fields] == ["examples"]


def test_a_default_that_is_written_down_is_the_same_set() -> None:
    assert content_sha256(rules("ROE-01")) == content_sha256(rules("ROE-01", tags=[], order=[]))
