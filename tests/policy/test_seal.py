"""A signed rule set stands as what was signed, or as altered; an unsigned one as not signed."""

from pathlib import Path

import pytest

from pa_console.policy.rule_seal import (
    AlteredRulesError,
    refuse_altered,
    sign_rules,
    signature_path,
)
from pa_console.policy.rulebook import load_rules, read_rule_set
from pa_console.schema.rule import RulesSeal
from pa_console.signing import KEY_VARIABLE, KNOWN_FILE, SigningError, load_signer
from tests.policy.book import write_rules


@pytest.fixture
def keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of this test's key."""
    folder = tmp_path / "keys"
    monkeypatch.setenv(KEY_VARIABLE, str(folder / "key.pem"))
    return folder


@pytest.fixture
def signed(tmp_path: Path, keys: Path) -> Path:
    """Return a rule file that this test's key has signed."""
    assert not keys.exists()
    path = write_rules(tmp_path, {})
    path.write_text("version: '1'\n" + path.read_text())
    sign_rules(path, read_rule_set(path)[1], load_signer())
    return path


def replace(path: Path, old: str, new: str) -> None:
    """Change a file in one place."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def seal(path: Path) -> RulesSeal:
    """Return how the rules at `path` stand."""
    return load_rules(path).seal


def test_a_set_without_a_signature_is_not_signed_and_is_taken(tmp_path: Path, keys: Path) -> None:
    path = write_rules(tmp_path, {})
    found = seal(path)
    assert (found.standing, found.version, len(found.content_sha256)) == ("not signed", "", 64)
    refuse_altered(path, found)
    assert not keys.exists()


def test_a_signed_set_is_known_by_the_key(signed: Path) -> None:
    found = seal(signed)
    assert (found.standing, found.version) == ("own key", "1")
    assert found.key == load_signer().fingerprint
    assert found.words == "signed by this machine's key"
    refuse_altered(signed, found)


def test_a_set_that_is_only_laid_out_anew_is_still_signed(signed: Path) -> None:
    signed.write_text("# a comment\n\n" + signed.read_text())
    assert seal(signed).standing == "own key"


@pytest.mark.parametrize(
    ("old", "new"),
    [("Be safe", "Be quick"), ("version: '1'", "version: '2'"), ("name: own", "name: other"),
     ("priority: high", "priority: medium")],
)  # fmt: skip
def test_an_altered_set_is_refused_with_what_to_do(signed: Path, old: str, new: str) -> None:
    replace(signed, old, new)
    found = seal(signed)
    assert found.altered
    with pytest.raises(AlteredRulesError) as caught:
        refuse_altered(signed, found)
    assert str(signed) in str(caught.value)
    assert "--unsigned" in str(caught.value)
    assert f"pa-console rules sign {signed}" in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [('"version": "1"', '"version": "2"', "was edited"), ('"name"', '"title"', "cannot be read"),
     ("{", "", "cannot be read")],
)  # fmt: skip
def test_a_signature_file_that_was_touched_is_an_altered_set(
    signed: Path, old: str, new: str, problem: str
) -> None:
    replace(signature_path(signed), old, new)
    found = seal(signed)
    assert found.altered
    assert problem in found.problem


def test_a_signature_taken_from_another_set_does_not_fit(signed: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    path = write_rules(other, {"text": "Another."})
    signature_path(path).write_bytes(signature_path(signed).read_bytes())
    assert seal(path).altered


def test_the_key_of_another_machine_is_unknown_until_it_is_named(signed: Path, keys: Path) -> None:
    key = seal(signed).key
    (keys / "key.pem").unlink()
    assert (seal(signed).standing, seal(signed).key) == ("unknown key", key)
    (keys / KNOWN_FILE).write_text(f"# who signs\n\n{key} Ada, policy desk\n")
    (keys / KNOWN_FILE).chmod(0o600)
    assert seal(signed).words == "signed by a known key (Ada, policy desk)"


def test_a_wrong_line_among_the_known_keys_is_named(signed: Path, keys: Path) -> None:
    (keys / "key.pem").unlink()
    (keys / KNOWN_FILE).write_text("# keys\nSHA256:short Ada\n")
    (keys / KNOWN_FILE).chmod(0o600)
    with pytest.raises(SigningError, match=f"{KNOWN_FILE}:2"):
        seal(signed)
