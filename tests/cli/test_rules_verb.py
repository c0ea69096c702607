"""`pa-console rules`: sets that are signed, pinned and compared; rules in recorded sessions."""

from pathlib import Path

import pytest

from pa_console.policy.authoring.lint_states import example_states
from pa_console.policy.rulebook import load_rules
from pa_console.schema.events.event import SessionStarted
from pa_console.session.log.chain import read_log
from pa_console.session.log.writer import LogWriter
from tests.cli.inside import Call
from tests.evaluation.sessions import RECON
from tests.policy.book import RULES, write_rules
from tests.station.test_effect import recorded

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


@pytest.mark.usefixtures("engine")
def test_with_unsigned_the_log_s_first_record_says_so(
    call: Call, signed: Path, tmp_path: Path
) -> None:
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
    assert "not for this set" in started.rules_seal.problem


def test_a_comparison_shows_rule_field_and_words(call: Call, signed: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(signed.read_text())
    same = call("rules", "diff", str(signed), str(other))
    assert (same.code, "no differences" in same.out) == (0, True)
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


STRICT = """
  - id: ROE-99
    domain: ROE
    priority: high
    text: "Nobody looks."
    check: "!actions.exists(a, a.verb == 'observe')"
    message: "somebody looks"
workflows:"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a log, a file that is none, and a stricter rule set."""
    path = tmp_path_factory.mktemp("recorded")
    with LogWriter(path / "one.jsonl", "S1") as writer:
        for event in recorded(RECON):
            writer.append(event)
    (path / "answers.jsonl").write_text('{"answer": 1}\n')
    (path / "strict.yaml").write_text(RULES.read_text().replace("\nworkflows:", STRICT, 1))
    return path


def test_what_turns_is_listed_and_told_by_the_exit_code(call: Call, folder: Path) -> None:
    log, strict = str(folder / "one.jsonl"), str(folder / "strict.yaml")
    same = call("rules", "effect", "checkpoint", str(folder))
    assert (same.code, same.err) == (0, "")
    assert "sessions 1, missions 1, plans 1" in same.out
    assert "changed: none; cannot be checked again: 0" in same.out
    done = call("rules", "effect", strict, log)
    assert done.code == 1
    assert f"{log}: session" in done.out
    assert "attempt 1 [Drone_T04 observe WestGate]: plan ROE-99: not blocked -> blocked" in done.out
    assert "changed: 1 finding, 1 plan, 1 decision" in done.out
    document = call("rules", "effect", strict, log, "--json").json
    assert document["turned"] == {"ROE-99": 3}
    assert [flip["kind"] for flip in document["sessions"][log]["flips"]] == [
        "finding", "plan", "decision"
    ]  # fmt: skip


def test_what_cannot_be_read_is_told(call: Call, folder: Path, tmp_path: Path) -> None:
    for words in (
        (str(folder / "answers.jsonl"),),
        (str(tmp_path),),
        (str(tmp_path / "none.jsonl"),),
        (),
        ("--missions", "nowhere"),
    ):
        done = call("rules", "effect", "checkpoint", *words)
        assert done.code == 2
        assert done.err


def test_a_log_cut_short_is_gone_through_up_to_there(
    call: Call, folder: Path, tmp_path: Path
) -> None:
    cut = tmp_path / "cut.jsonl"
    cut.write_bytes((folder / "one.jsonl").read_bytes()[:-20])
    done = call("rules", "effect", str(folder / "strict.yaml"), str(cut))
    assert done.code == 2
    assert "changed: 1 finding, 1 plan, 1 decision" in done.out
    assert f"{cut}: not read completely" in done.err
    assert call("rules", "trace", "ROE-01", str(cut)).code == 2


def test_missions_of_a_set_are_tried_with_single_orders(
    call: Call, folder: Path, tmp_path: Path
) -> None:
    few = tmp_path / "few.yaml"
    few.write_text("name: few\nmissions:\n  - {id: A1, category: c, command: Look around.}\n")
    idle = tmp_path / "idle.yaml"
    text = (folder / "strict.yaml").read_text()
    idle.write_text(text.replace("!actions.exists(a, a.verb == 'observe')", "size(actions) == 0"))
    words = ("rules", "effect", str(idle), "--missions", str(few), "--plans", "8", "--seed", "1")
    done = call(*words)
    assert done.code == 1
    assert "[no orders]" not in done.out
    assert done.out.count("finding ROE-99: no such rule -> violates (high)") == 8
    assert "plan ROE-99: not blocked -> blocked: ROE-99: somebody looks" in done.out
    assert "missions 1, plans 9" in done.out
    assert call(*words).out == done.out


def test_a_rule_is_followed_to_its_missions(call: Call, folder: Path) -> None:
    done = call("rules", "trace", "ROE-01", str(folder))
    assert (done.code, done.err) == (0, "")
    assert "retrieved: rank" in done.out
    assert "attempt 1: decided" in done.out
    assert (
        "ROE-01, missions: retrieved in 1, decided in 1, broken in 0, prescribed in 0; "
        "sessions searched: 1" in done.out
    )
    document = call("rules", "trace", "ROE-01", str(folder), "--json").json
    (trails,) = document["sessions"].values()
    assert {entry["did"] for entry in trails[0]["entries"]} >= {"retrieved", "decided"}
    assert call("rules", "trace", "ROE-77", str(folder)).code == 1
    assert call("rules", "trace", "ROE-01", str(folder / "strict.yaml")).code == 2
