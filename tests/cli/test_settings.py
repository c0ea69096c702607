"""`pa-console settings`, and that other verbs follow what was chosen."""

import json
from pathlib import Path

import pytest

from tests.cli.inside import Call


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's settings file, which is not there yet."""
    path = tmp_path / "settings.yaml"
    monkeypatch.setenv("PA_CONSOLE_SETTINGS", str(path))
    return path


def test_show_says_what_is_chosen_and_where(
    call: Call, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file.write_text("speed: 2\n")
    monkeypatch.setenv("PA_CONSOLE_MOUSE", "off")
    done = call("--set", "theme=nord", "settings", "show", "--json")
    assert done.code == 0
    rows = {row["name"]: row for row in done.json["settings"]}
    assert (rows["speed"]["value"], rows["speed"]["place"]) == (2.0, f"{file}:1")
    assert (rows["mouse"]["value"], rows["mouse"]["place"]) == (False, "PA_CONSOLE_MOUSE")
    assert (rows["theme"]["value"], rows["theme"]["source"]) == ("nord", "command line")
    assert (rows["world"]["value"], rows["world"]["source"]) == ("checkpoint", "default")
    said = call("settings", "show").said
    assert all(name in said for name in rows)
    assert "file, line 1" in said


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("theme: nrod\n", "settings.yaml:1: theme: there is no theme “nrod”"),
        ("keys: {stop: f8}\n", "settings.yaml:1: keys.stop: F8 is the key of cancel"),
        ("keys: {stopp: f11}\n", "did you mean stop"),
        ("model: smollm\n", "smollm2-135m"),
        ("rules: nowhere\n", "known: checkpoint"),
        ("speed: 20\n", "from 1 to 8"),
    ],
)
def test_show_names_what_cannot_be_used(call: Call, file: Path, text: str, says: str) -> None:
    file.write_text(text)
    done = call("settings", "show")
    assert done.code == 2
    assert says in done.said


def test_a_setting_is_set_checked_and_unset(call: Call, file: Path) -> None:
    assert call("settings", "set", "keys.stop", "f11").code == 0
    assert call("settings", "set", "approval-delay-s", "2").code == 0
    assert file.read_text().endswith("keys:\n  stop: f11\napproval_delay_s: 2.0\n")
    for words, says in (
        (("approval_delay_s", "60"), "from 0.2 to 10"),
        (("keys.stop", "tab"), "move around"),
        (("model", "smollm"), "smollm2-135m"),
        (("nothing", "1"), "unknown setting"),
        (("logs", str(file)), "is not a folder"),
    ):
        done = call("settings", "set", *words)
        assert done.code == 2
        assert says in done.said
    assert call("settings", "unset", "keys.stop").code == 0
    assert file.read_text().endswith("\napproval_delay_s: 2.0\n")


def test_a_variable_that_wins_is_told(
    call: Call, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PA_CONSOLE_SPEED", "4")
    assert "PA_CONSOLE_SPEED overrides the file" in call("settings", "set", "speed", "2").said
    assert file.exists()


def test_path_and_reset_work_with_a_file_that_is_broken(call: Call, file: Path) -> None:
    file.write_text("theme: [")
    assert call("rules", "list").code == 2
    assert call("settings", "path").out.strip() == str(file)
    assert "settings.yaml.bak" in call("settings", "reset").said
    assert call("settings", "show").code == 0
    assert "does not exist; the defaults apply" in call("settings", "reset").said


def test_chosen_rules_are_the_default_and_an_option_wins(call: Call, file: Path) -> None:
    rule = "{id: WF-99, domain: WF, priority: high, text: t, check: 'true', message: m}"
    mine = file.with_name("mine.yaml")
    mine.write_text(f"name: mine\nrules:\n  - {rule}\n")
    file.write_text(f"rules: {mine}\n")
    assert [found["id"] for found in call("rules", "list", "--json").json] == ["WF-99"]
    assert len(call("rules", "list", "--rules", "checkpoint", "--json").json) == 35
    assert len(json.loads(call("--set", "rules=checkpoint", "rules", "list", "--json").out)) == 35


@pytest.mark.parametrize("word", ["theme", "themes=x", "speed=9"])
def test_a_wrong_assignment_is_refused(call: Call, word: str) -> None:
    done = call("--set", word, "rules", "list")
    assert done.code == 2
    assert f"--set {word.partition('=')[0]}" in done.said
