"""What a rule file leaves to standing orders: nothing, unless it names commands."""

from pathlib import Path

import pytest

from pa_console.policy.rule_seal import content_sha256
from pa_console.policy.rulebook import load_rules
from pa_console.resources import data_folder
from pa_console.schema.document import DocumentError

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
