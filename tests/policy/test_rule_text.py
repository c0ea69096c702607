"""One rule of a file is edited as text, and every other byte of the file stays as it was."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.policy.authoring.rule_save import RuleText
from pa_console.resources import find_data
from pa_console.schema.document import DocumentError

SHIPPED = find_data("rules", "checkpoint", "rules.yaml")

FILE = """\
# What this set is for.
name: small   # a name
rules:
  # ------------ first part

  # About the first.
  - id: ROE-01
    domain: ROE   # its domain
    priority: high
    text: >-
      folded
      words
    # the end of the first

  -   id: ROE-02
      text: 'quoted: yes'
      check: |-
        size(actions) > 0

          && true


  # about the flow
  - {id: WF-01, text: "in braces",
     tags: [a, b]}
  -
    id: CAP-01
    text: last
workflows: []  # none
"""

LINES = st.lists(
    st.sampled_from(("tags: [x]", "  # deeper", "", "text: new", "   ", "check: |-", "  true")),
    max_size=4,
)


def values(text: str) -> dict[str, object]:
    """Return the rules of a file by their ids, as YAML reads them."""
    return {rule["id"]: rule for rule in yaml.safe_load(text)["rules"]}


def line_ends(text: str, end: str) -> str:
    return text.replace("\n", end)


STRETCH = {
    "ROE-01": ("  # About the first.\n", "    # the end of the first\n"),
    "ROE-02": ("  -   id: ROE-02\n", "          && true\n"),
    "WF-01": ("  # about the flow\n", "     tags: [a, b]}\n"),
    "CAP-01": ("  -\n    id: CAP-01\n", "    text: last\n"),
}
"""The first and the last line of each rule."""


@settings(deadline=None, max_examples=60)
@given(
    which=st.sampled_from(tuple(STRETCH)), lines=LINES, end=st.sampled_from(("\n", "\r\n")),
    short=st.booleans(),
)  # fmt: skip
def test_only_the_lines_of_the_edited_rule_change(
    which: str, lines: list[str], end: str, short: bool
) -> None:
    text = line_ends(FILE, end)
    if short:
        text = text[: text.index(f"{end}workflows")]  # ends in a rule, without a line end
    file = RuleText("f", text)
    new = file.put(which, "\n".join((f"id: {which}", "domain: ROE", *lines)) + "\n")
    first, last = STRETCH[which]
    start = text.index(line_ends(first, end))
    stop = text.index(last.rstrip("\n"), start) + len(line_ends(last, end))
    assert new.startswith(text[:start])
    assert new.endswith(text[stop:])
    try:
        after = RuleText("f", new)
    except DocumentError:
        return  # what was typed is no YAML; saving refuses it
    for name in (name for name in file.ids if name != which):
        assert after.rule(name).strip() == file.rule(name).strip()
        assert values(new)[name] == values(text)[name]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_rule_that_is_not_changed_leaves_the_file_as_it_is(end: str) -> None:
    text = line_ends(FILE, end)
    file = RuleText("f", text)
    for name in file.ids:
        assert file.put(name, file.rule(name)) == text
        changed = file.put(name, file.rule(name) + "# more\n")
        assert changed != text
        assert RuleText("f", changed).put(name, file.rule(name)) == text


def test_every_shipped_rule_can_be_edited_without_touching_the_others() -> None:
    text = SHIPPED.read_text(encoding="utf-8")
    file = RuleText("f", text)
    for name in file.ids:
        changed = file.put(name, f"{file.rule(name)}# more\n")
        line = next(line for line in changed.split("\n") if line.strip() == "# more")
        same = changed.replace(f"{line}\n", "", 1) == text
        assert same, name


def test_a_rule_is_shown_with_its_comments_and_without_its_indent() -> None:
    file = RuleText("f", FILE)
    assert file.ids == ("ROE-01", "ROE-02", "WF-01", "CAP-01")
    assert file.rule("ROE-01").startswith("# About the first.\nid: ROE-01\ndomain: ROE   # its")
    assert file.rule("ROE-01").endswith("  words\n# the end of the first\n")
    assert file.rule("ROE-02").endswith("check: |-\n  size(actions) > 0\n\n    && true\n")
    assert file.rule("CAP-01") == "id: CAP-01\ntext: last\n"
    assert file.line("ROE-02") == FILE[: FILE.index("  -   id")].count("\n") + 1
    assert yaml.safe_load(file.rule("WF-01")) == values(FILE)["WF-01"]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_rule_is_added_after_the_last_and_taken_away_again(end: str) -> None:
    text = line_ends(FILE, end)
    new = RuleText("f", text).add("# mine\n\nid: ROE-07\ncheck: |-\n  true\n\n  && false\n")
    assert list(values(new)) == ["ROE-01", "ROE-02", "WF-01", "CAP-01", "ROE-07"]
    assert new.endswith(f"&& false{end}workflows: []  # none{end}")
    assert new.startswith(text[: text.index("workflows")])
    kept = RuleText("f", new).remove("ROE-07")
    assert values(kept) == values(text)


def test_removing_a_rule_takes_its_own_comments_and_nothing_else() -> None:
    without = RuleText("f", FILE).remove("ROE-01")
    start, stop = FILE.index("  # About"), FILE.index("  -   id: ROE-02")
    assert without == FILE[:start] + FILE[stop:]
    with pytest.raises(ValueError, match="only rule"):
        RuleText("f", "rules:\n- id: ROE-01\n").remove("ROE-01")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("rules: [{id: A}]\n", "one below the other"),
        ("name: x\n", "list of rules"),
        ("rules:\n  - id: [\n", "not valid YAML"),
        ("rules:\r  - id: A\r", "CR only"),
    ],
)
def test_a_file_that_cannot_be_cut_says_why(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(DocumentError, match=problem):
        RuleText(str(tmp_path / "r.yaml"), text)
