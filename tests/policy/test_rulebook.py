"""A rule file is in force as written or refused, with file, line and field."""

import hashlib
from pathlib import Path
from typing import Any

import pytest

from pa_console.policy.rulebook import load_rules
from pa_console.schema.document import DocumentError
from tests.policy.book import RULES, checkpoint_rules, write_rules

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
        ({"order": [ORDER | {"kind": "within"}]}, "rules.0.order.0", "seconds belongs"),
        ({"order": [ORDER | {"seconds": 4}]}, "rules.0.order.0", "seconds belongs"),
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
