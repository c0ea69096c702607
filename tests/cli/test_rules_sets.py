"""Rule sets on the command line: signed, compared, and refused when they were altered."""

from pathlib import Path

import pytest

from pa_console.cli.sessions import mission as mission_session
from pa_console.llm.models.catalogue import LocalModel
from pa_console.policy.authoring.lint_states import example_states
from pa_console.policy.rulebook import load_rules
from pa_console.schema.events.event import SessionStarted
from pa_console.session.log.chain import read_log
from tests.cli.inside import Call
from tests.policy.book import RULES, write_rules
from tests.scripted import ScriptedEngine

CALM = "name: calm\ntitle: Nothing happens\nabout: for a test\nduration_s: 1\n"


@pytest.fixture
def signed(tmp_path: Path, call: Call) -> Path:
    """Return a small rule file, signed."""
    path = write_rules(tmp_path, {})
    path.write_text("version: 1.0.0\n" + path.read_text())
    done = call("rules", "sign", str(path))
    assert (done.code, done.err) == (0, "")
    assert f"{path}.sig: own, version 1.0.0" in done.out
    assert "SHA256:" in done.out
    return path


def alter(path: Path) -> None:
    """Change what a rule says."""
    path.write_text(path.read_text().replace("Be safe.", "Be very safe."))


def test_version_hash_and_standing_are_shown(call: Call, signed: Path) -> None:
    assert "version 1.0.0, content" in call("rules", "list", "--rules", str(signed)).said
    assert "signed by this machine's key" in call("rules", "check", str(signed)).said
    seal = call("rules", "check", str(signed), "--json").json["seal"]
    assert (seal["standing"], seal["version"]) == ("own key", "1.0.0")
    assert "as shipped" in call("rules", "check").said


def test_an_altered_set_fails_the_check(call: Call, signed: Path) -> None:
    alter(signed)
    done = call("rules", "check", str(signed))
    assert done.code == 2
    assert "ALTERED since it was signed" in done.said
    assert "ALTERED" in call("rules", "list", "--rules", str(signed)).said
    assert call("rules", "sign", str(signed)).code == 0
    assert call("rules", "check", str(signed)).code == 0


@pytest.mark.parametrize("verb", [("mission", "hello"), ("eval",)])
def test_an_altered_set_is_not_put_in_force(
    call: Call, signed: Path, verb: tuple[str, ...]
) -> None:
    alter(signed)
    done = call(*verb, "--rules", str(signed))
    assert (done.code, done.out) == (2, "")
    assert "ALTERED since it was signed" in done.err
    assert "--unsigned" in done.err


@pytest.mark.usefixtures("engine")
def test_the_console_refuses_an_altered_set(
    call: Call, signed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    alter(signed)
    done = call("console", "--rules", str(signed))
    assert done.code == 2
    assert "ALTERED since it was signed" in done.err


def test_with_unsigned_the_log_s_first_record_says_so(
    call: Call, signed: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    engine = ScriptedEngine([])

    def find_model(_: str | None, *_progress: object, **_reader: str) -> LocalModel:
        return engine.model

    def new_engine(_: LocalModel) -> ScriptedEngine:
        return engine

    monkeypatch.setattr(mission_session, "find_model", find_model)
    monkeypatch.setattr(mission_session, "Engine", new_engine)
    alter(signed)
    scenario, log = tmp_path / "calm.yaml", tmp_path / "session.jsonl"
    scenario.write_text(CALM)
    words = ("mission", "--scenario", str(scenario), "--rules", str(signed), "--log", str(log))
    done = call(*words, "--unsigned")
    assert done.code == 0
    assert "warning" in done.err
    assert "ALTERED since it was signed" in done.err
    started = next(iter(read_log(log))).data
    assert isinstance(started, SessionStarted)
    assert started.rules_seal is not None
    assert started.rules_seal.standing == "altered"
    assert "this is another" in started.rules_seal.problem


def test_a_comparison_shows_rule_field_and_words(call: Call, signed: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(signed.read_text())
    same = call("rules", "diff", str(signed), str(other))
    assert (same.code, "the same rules" in same.out) == (0, True)
    alter(other)
    done = call("rules", "diff", str(signed), str(other))
    assert (done.code, done.err) == (1, "")
    assert "changed: rule ROE-01" in done.out
    assert "text: Be{+ very+} safe." in done.out
    assert "1 changed" in done.out
    document = call("rules", "diff", str(signed), str(other), "--json").json
    assert not document["equal"]
    [change] = document["changes"]
    assert (change["id"], change["fields"][0]["before"]) == ("ROE-01", "Be safe.")
    assert document["sets"][0]["seal"]["standing"] == "own key"


@pytest.mark.parametrize("words", [("diff", "checkpoint", "none.yaml"), ("sign", "none.yaml")])
def test_a_file_that_is_not_there_is_bad_input(call: Call, words: tuple[str, ...]) -> None:
    done = call("rules", *words)
    assert (done.code, done.out) == (2, "")
    assert "none.yaml" in done.err


def test_lint_names_file_line_and_rule_and_is_quiet_about_the_installed_rules(
    call: Call, tmp_path: Path
) -> None:
    done = call("rules", "lint", "--states", "20")
    assert done.code == 0
    known = len(list(example_states(entry.rule for entry in load_rules(RULES).compiled)))
    assert f"searched: {known + 20} states ({known} of examples), 2 situations" in done.out
    path = write_rules(tmp_path, {"check": "size(actions) > 0", "message": "m"})
    done = call("rules", "lint", str(path), "--states", "20")
    assert (done.code, done.err) == (1, "")
    assert f"{path}:7: warning: ROE-01: no examples" in done.out
    path.write_text("\n" * 93 + path.read_text())
    assert f"{path}:100: warning: ROE-01" in call("rules", "lint", str(path), "--states", "0").out
    document = call("rules", "lint", str(path), "--json", "--states", "0").json
    assert document["findings"][0]["line"] == 100
    assert document["counts"] == {"error": 0, "warning": 1, "note": 0}
    assert call("rules", "lint", str(path), "--world", "nowhere").code == 2
