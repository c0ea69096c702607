"""A rule is checked while it is written: what is wrong is told with line, column and field."""

import errno
import os
from pathlib import Path

import pytest

from pa_console.policy.authoring.rule_draft import check_draft
from pa_console.policy.authoring.rule_save import (
    RulesChangedError,
    new_rule,
    open_rule,
    remove_rule,
    save_rule,
)
from pa_console.policy.rulebook import load_rules
from pa_console.schema.document import DocumentError

GOOD = """\
# Nobody drives through the depot.
id: CAP-11
domain: CAP
priority: high
text: "Keep out of the depot."
applies: "size(actions) > 0"
check: |-
  actions
    .filter(a, a.goes_to == 'Depot')
    .map(a, a.agent)
message: "goes to the depot"
examples:
  - name: keeps out
    expect: pass
    plan: [[Drone_T04, observe WestGate]]
  - name: goes there
    expect: fail
    plan: [[Drone_T04, move_to Depot]]
"""


def test_a_good_rule_has_its_examples_run() -> None:
    draft = check_draft(GOOD)
    assert draft.problem is None
    assert draft.entry is not None
    assert [result.right for result in draft.examples] == [True, True]
    assert draft.examples[1].message == "goes to the depot: Drone_T04"
    wrong = check_draft(GOOD.replace("'Depot'", "'Base'"))
    assert [(result.expect, result.got) for result in wrong.wrong] == [("fail", "pass")]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("priority: high", "priority: hihg", "line 4: priority: Input should be"),
        ("text:", "txt:", "line 5: txt: there is no such field"),
        ("priority: high\n", "", "line 2: priority: Field required"),
        ("message:", "message: [", "line 12, column 1: not valid YAML"),
        ('"size(actions) > 0"', '"size(actions) >"', "line 6, column 26: applies: not valid CEL"),
        ("size(actions) > 0", "size(actoins) > 0", "line 6, column 16: applies: unknown name"),
        ("    .map(a", "    .mpa(a", "line 10, column 6: check: unknown function 'mpa'"),
        ("Depot')", "Depot'", "line 10, column"),
        ("id: CAP-11", "id: WF-11", "id 'WF-11' does not start with its domain"),
        ("id: CAP-11", "id: CAP-01", "line 2: id: 'CAP-01' is another rule's"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(old: str, new: str, said: str) -> None:
    draft = check_draft(GOOD.replace(old, new, 1), taken=("CAP-01",))
    assert draft.problem is not None
    assert said in str(draft.problem)
    assert draft.entry is None
    assert not draft.examples


def test_in_a_folded_expression_the_line_of_the_field_is_told() -> None:
    draft = check_draft(GOOD.replace("check: |-", "check: >-").replace("Depot')", "Depot'"))
    assert draft.problem is not None
    assert (draft.problem.line, draft.problem.column) == (7, 0)


@pytest.mark.parametrize("text", ["", "just words", "- id: CAP-11", "a: &x [*x]", "\t", "{"])
def test_whatever_is_typed_there_is_an_answer(text: str) -> None:
    assert check_draft(text).problem is not None


FILE = """\
name: house
rules:
  # The first, by the model.
  - id: ROE-01
    domain: ROE
    priority: high
    text: Be kind.   # always

  - id: WF-01
    domain: WF
    priority: medium
    text: Report.
    tags: [report]
workflows:
  - id: w
    rule: WF-01
    starts: "true"
    phases:
      - {name: one, command: look, done: "true"}
"""


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    path = tmp_path / "house.yaml"
    path.write_text(FILE, encoding="utf-8")
    return path


def test_a_rule_is_edited_added_renamed_and_removed(rules: Path) -> None:
    opened = open_rule(rules, "ROE-01")
    saved = save_rule(opened, opened.text.replace("Be kind.", "Be polite."))
    assert rules.read_text() == FILE.replace("Be kind.", "Be polite.")
    saved = save_rule(saved, saved.text.replace("ROE-01", "ROE-05"))
    assert (saved.id, saved.taken) == ("ROE-05", ("WF-01",))
    added = save_rule(new_rule(rules, "CAP"), GOOD)
    assert (added.id, added.text) == ("CAP-11", GOOD)
    assert [rule.id for rule in load_rules(rules).rules] == ["ROE-05", "WF-01", "CAP-11"]
    remove_rule(added)
    remove_rule(open_rule(rules, "ROE-05"))
    assert [rule.id for rule in load_rules(rules).rules] == ["WF-01"]
    assert [path.name for path in rules.parent.iterdir()] == ["house.yaml"]


def test_the_form_of_a_new_rule_is_a_rule_whose_examples_are_right(rules: Path) -> None:
    form = new_rule(rules, "WF")
    saved = save_rule(form, form.text)
    assert saved.id == "WF-02"
    assert load_rules(rules).get("WF-02").examples


@pytest.mark.parametrize(
    ("edited", "problem"),
    [
        ("id: ROE-01\n", "domain: Field required"),
        ("- a\n- b\n", "house.yaml"),
        ("text: x\n- id: ROE-02\n", "house.yaml"),
        ("id: WF-01\ndomain: WF\npriority: high\ntext: x\n", "appears twice"),
        (
            "id: ROE-01\ndomain: ROE\npriority: high\ntext: x\ncheck: size(\nmessage: m\n",
            "check: not valid CEL",
        ),
    ],
)
def test_what_would_break_the_set_is_not_saved(rules: Path, edited: str, problem: str) -> None:
    with pytest.raises(DocumentError, match=problem):
        save_rule(open_rule(rules, "ROE-01"), edited)
    assert rules.read_text() == FILE


def test_a_rule_that_a_workflow_needs_is_not_removed(rules: Path) -> None:
    with pytest.raises(DocumentError, match="there is no rule 'WF-01'"):
        remove_rule(open_rule(rules, "WF-01"))
    assert rules.read_text() == FILE


def test_a_file_changed_meanwhile_is_not_overwritten_without_asking(rules: Path) -> None:
    opened = open_rule(rules, "ROE-01")
    rules.write_text(FILE.replace("Report.", "Report at once."))
    text = opened.text.replace("Be kind.", "Be polite.")
    with pytest.raises(RulesChangedError, match="but not this rule") as caught:
        save_rule(opened, text)
    assert not caught.value.same_rule
    save_rule(opened, text, anyway=True)
    both = FILE.replace("Report.", "Report at once.").replace("Be kind.", "Be polite.")
    assert rules.read_text() == both
    with pytest.raises(RulesChangedError, match="and so has this rule"):
        save_rule(opened, opened.text)
    rules.write_text(FILE.replace("ROE-01", "ROE-04"))
    with pytest.raises(DocumentError, match="no longer has this rule"):
        save_rule(opened, text, anyway=True)


def test_a_read_only_file_is_left_alone(rules: Path) -> None:
    opened = open_rule(rules, "ROE-01")
    rules.chmod(0o444)
    with pytest.raises(PermissionError, match="read-only"):
        save_rule(opened, opened.text.replace("kind", "polite"))
    assert rules.read_text() == FILE


def test_on_a_full_disk_the_file_stays_whole(rules: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = open_rule(rules, "ROE-01")

    def full(_number: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        save_rule(opened, opened.text.replace("kind", "polite"))
    assert rules.read_text() == FILE
    assert [path.name for path in rules.parent.iterdir()] == ["house.yaml"]


def test_a_link_stays_a_link_and_the_mode_is_kept(rules: Path, tmp_path: Path) -> None:
    rules.chmod(0o640)
    link = tmp_path / "link.yaml"
    link.symlink_to(rules)
    opened = open_rule(link, "ROE-01")
    save_rule(opened, opened.text.replace("kind", "polite"))
    assert link.is_symlink()
    assert "polite" in rules.read_text()
    assert rules.stat().st_mode & 0o777 == 0o640


def test_a_rule_that_leans_on_another_is_edited_in_the_file(rules: Path) -> None:
    rules.write_text(FILE.replace("tags: [report]", "tags: &t [report]").replace(
        "text: Be kind.   # always", "text: Be kind.\n    tags: [x]"
    ))  # fmt: skip
    open_rule(rules, "WF-01")
    rules.write_text(rules.read_text() + "  - {id: v, rule: WF-01, starts: 'true', phases: []}\n")
    rules.write_text(FILE.replace("text: Be kind.", "text: &w Be kind.").replace(
        "text: Report.", "text: *w"
    ))  # fmt: skip
    with pytest.raises(DocumentError, match="cannot stand alone"):
        open_rule(rules, "WF-01")
