"""A rule is checked while it is written: what is wrong is told with line, column and field."""

import pytest

from pa_console.policy.authoring.rule_draft import check_draft

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
