"""A rule file is in force as written or refused, with file, line and field."""

import hashlib
from pathlib import Path
from typing import Any

import pytest

from pa_console.policy.rulebook import load_rules
from pa_console.schema.document import DocumentError
from tests.policy.book import RULES, checkpoint_rules, write_rules

CHECKED: dict[str, Any] = {"check": "size(actions) > 0", "message": "the plan is empty"}


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
        ({"weight": 3}, "rules.0.weight", "not permitted"),
        ({"priority": "urgent"}, "rules.0.priority", "critical"),
        ({"id": "roe1"}, "rules.0.id", "pattern"),
        ({"id": "WF-01"}, "rules.0", "does not start with its domain"),
        ({"text": ""}, "rules.0.text", "at least 1"),
        ({"check": "true"}, "rules.0", "needs a message"),
        ({"message": "why"}, "rules.0", "need a check"),
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
