"""A rule file is in force as written or refused, with file, line and field."""

import hashlib
import random
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.policy.authoring.differences import compare_rules, word_changes
from pa_console.policy.rule_seal import content_sha256
from pa_console.policy.rulebook import load_rules
from pa_console.resources import data_folder
from pa_console.schema.document import Document, DocumentError
from pa_console.schema.rule import RuleSet
from tests.policy.book import RULES, checkpoint_rules, write_rules
from tests.policy.sets import WORDS, as_set, edited, rule_sets, shuffled, texts

CHECKED: dict[str, Any] = {"check": "size(actions) > 0", "message": "the plan is empty"}

ORDER: dict[str, Any] = {
    "kind": "before", "each": "track", "event": "it.warned", "other": "it.observed",
    "message": "wrong order",
}  # fmt: skip
EMPTY: dict[str, Any] = {}
WHOLE: dict[str, Any] = {key: value for key, value in ORDER.items() if key != "each"}
PHASE: dict[str, Any] = {"name": "go", "command": "go to {gate}", "done": "it.observed"}
WORKFLOW: dict[str, Any] = {"id": "own", "rule": "ROE-01", "starts": "true", "phases": [PHASE]}


def test_the_shipped_rules_load() -> None:
    book = checkpoint_rules()
    assert book.name == "checkpoint"
    assert book.get("WF-03").priority == "high"
    assert book.sha256 == hashlib.sha256(RULES.read_bytes()).hexdigest()


def test_a_rule_that_is_not_in_force_is_a_key_error() -> None:
    with pytest.raises(KeyError):
        checkpoint_rules().get("ROE-99")


@pytest.mark.parametrize(
    ("rule", "field", "problem"),
    [
        ({"weight": 3}, "rules.0.weight", "no such field"),
        ({"priority": "urgent"}, "rules.0.priority", "critical"),
        ({"id": "roe1"}, "rules.0.id", "pattern"),
        ({"id": "WF-01"}, "rules.0", "does not start with its domain"),
        ({"text": ""}, "rules.0.text", "at least 1"),
        ({"check": "true"}, "rules.0", "needs a message"),
        ({"message": "why"}, "rules.0", "need a check"),
        ({"examples": [{"name": "x", "expect": "pass"}]}, "rules.0", "needs a check"),
        (CHECKED | {"examples": [{"name": "x", "expect": "pass", "moments": [EMPTY]}]}, "rules.0",
         "needs an order"),
        (CHECKED | {"examples": [{"name": "x", "expect": "pass", "moments": [EMPTY],
                                  "given": {"assets": EMPTY}}]}, "rules.0.examples.0.moments",
         "either"),
        ({"order": [ORDER | {"kind": "until", "each": "asset"}]}, "rules.0.order.0.each", "track"),
        ({"order": [ORDER, ORDER | {"event": "it.warned ||"}]}, "rules.0.order.1.event",
         "not valid CEL"),
        ({"order": [ORDER | {"event": "before.time_s > 1.0"}]}, "rules.0.order.0.event",
         "unknown name 'before'"),
        ({"order": [ORDER | {"other": "tracks.exists(t, t.warned)"}]}, "rules.0.order.0.other",
         "unknown name 'tracks'"),
        ({"order": [WHOLE | {"event": "it.warned"}]}, "rules.0.order.0.event", "unknown name 'it'"),
        ({"order": [ORDER | {"kind": "within"}]}, "rules.0.order.0", "seconds is required"),
        ({"order": [ORDER | {"seconds": 4}]}, "rules.0.order.0", "seconds is required"),
        ({"order": [ORDER | {"kind": "within", "seconds": "now.time_s"}]},
         "rules.0.order.0.seconds", "unknown name 'now'"),
        (CHECKED | {"check": "size(plan"}, "rules.0.check", "not valid CEL"),
        (CHECKED | {"check": ""}, "rules.0.check", "not valid CEL"),
        (CHECKED | {"applies": "a b"}, "rules.0.applies", "not valid CEL"),
        (CHECKED | {"check": "trakcs == []"}, "rules.0.check", "unknown name 'trakcs'"),
        (CHECKED | {"check": "actions.exists(a, b.x)"}, "rules.0.check", "unknown name 'b'"),
        (CHECKED | {"check": "len(actions) > 0"}, "rules.0.check", "unknown function 'len'"),
        (CHECKED | {"check": "actions.exists(a)"}, "rules.0.check", "unknown"),
        (CHECKED | {"examples": [{"name": "x", "expect": "maybe"}]}, "rules.0.examples.0.expect",
         "pass"),
    ],
)  # fmt: skip
def test_a_bad_rule_is_named_with_file_line_and_field(
    tmp_path: Path, rule: dict[str, Any], field: str, problem: str
) -> None:
    path = write_rules(tmp_path, rule)
    with pytest.raises(DocumentError) as caught:
        load_rules(path)
    error = caught.value
    assert (error.source, error.field) == (str(path), field)
    assert problem in error.problem
    last = field.rsplit(".", maxsplit=1)[-1]
    line = path.read_text(encoding="utf-8").splitlines()[error.line - 1]
    assert last in line or last == "0"


@pytest.mark.parametrize(
    ("workflow", "field", "problem"),
    [
        ({"starts": "it.warned &&"}, "workflows.0.starts", "not valid CEL"),
        ({"starts": "world.base == ''"}, "workflows.0.starts", "unknown name 'world'"),
        ({"ends": {"gone home": "it.status = 1"}}, "workflows.0.ends.gone home", "not valid CEL"),
        ({"phases": [PHASE, PHASE | {"done": "len(id)"}]}, "workflows.0.phases.1.done", "'len'"),
        ({"phases": [PHASE | {"when": "track.warned"}]}, "workflows.0.phases.0.when", "'track'"),
        ({"phases": [PHASE | {"command": "go to {place}"}]}, "workflows.0.phases.0.command",
         "'{place}'"),
        ({"phases": [PHASE | {"command": "go to {gate"}]}, "workflows.0.phases.0.command", "only"),
        ({"phases": [PHASE | {"command": "{gate.upper.x}"}]}, "workflows.0.phases.0.command", "x"),
        ({"phases": []}, "workflows.0.phases", "at least 1"),
        ({"id": "Own"}, "workflows.0.id", "pattern"),
        ({"rule": "WF-01"}, "", "there is no rule 'WF-01'"),
    ],
)  # fmt: skip
def test_a_bad_workflow_is_named_with_file_line_and_field(
    tmp_path: Path, workflow: dict[str, Any], field: str, problem: str
) -> None:
    with pytest.raises(DocumentError) as caught:
        load_rules(write_rules(tmp_path, {}, workflows=[WORKFLOW | workflow]))
    assert caught.value.field == field
    assert problem in caught.value.problem


def test_two_workflows_cannot_have_one_id(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match="'own' appears twice") as caught:
        load_rules(write_rules(tmp_path, {}, workflows=[WORKFLOW, WORKFLOW]))
    assert caught.value.field == "workflows.1.id"


def test_a_syntax_error_is_located_inside_the_expression(tmp_path: Path) -> None:
    path = write_rules(tmp_path, CHECKED | {"check": "true &&\n  )"})
    with pytest.raises(DocumentError, match=r"line 2, column 3"):
        load_rules(path)


def test_an_id_that_appears_twice_is_refused_where_it_appears_again(tmp_path: Path) -> None:
    path = write_rules(tmp_path, {}, {"id": "ROE-01", "text": "Again."})
    with pytest.raises(DocumentError, match="'ROE-01' appears twice") as caught:
        load_rules(path)
    assert caught.value.field == "rules.1.id"
    assert caught.value.line > 3


def test_a_missing_file_and_an_empty_rule_set_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match="No such file"):
        load_rules(tmp_path / "none.yaml")
    with pytest.raises(DocumentError, match="rules"):
        load_rules(write_rules(tmp_path))


SHIPPED = data_folder() / "rules" / "checkpoint.yaml"
STANDING = "standing: {allowed: [move_to, observe, return_to_base]}\n"


def with_head(tmp_path: Path, line: str) -> Path:
    """Write the shipped rules with `line` in place of what they leave to standing orders."""
    path = tmp_path / "rules.yaml"
    text = SHIPPED.read_text()
    assert STANDING in text
    path.write_text(text.replace(STANDING, line))
    return path


def test_the_shipped_rules_leave_no_more_to_them_than_to_relieve_an_asset() -> None:
    assert load_rules(SHIPPED).unasked == ("move_to", "observe", "return_to_base")


def test_a_file_that_names_nothing_leaves_them_nothing(tmp_path: Path) -> None:
    book = load_rules(with_head(tmp_path, ""))
    assert book.unasked == ()
    assert book.rule_set is not None
    assert "standing" not in book.rule_set.model_dump(), "the bytes of rule sets stay"


def test_what_is_allowed_is_part_of_what_is_signed(tmp_path: Path) -> None:
    book = load_rules(with_head(tmp_path, "standing: {allowed: [observe, return_to_base]}\n"))
    assert book.unasked == ("observe", "return_to_base")
    assert book.rule_set is not None
    plain = load_rules(SHIPPED).rule_set
    assert plain is not None
    assert content_sha256(book.rule_set) != content_sha256(plain)


@pytest.mark.parametrize(
    "head", ["standing: {allowed: [shoot]}\n", "standing: {permitted: [observe]}\n"]
)
def test_what_is_no_command_is_an_error_with_its_place(tmp_path: Path, head: str) -> None:
    with pytest.raises(DocumentError, match=r"rules\.yaml:\d+.*standing"):
        load_rules(with_head(tmp_path, head))


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
