"""Every verb as a user runs it: what it prints, its exit code, and that no traceback appears."""

import errno
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.core import TyperGroup
from typer.main import get_command

from pa_console import __version__
from pa_console.cli.main import app
from pa_console.cli.verbs import EXAMPLES, VERBS, load_verb, models
from tests.cli.inside import Call
from tests.cli.parsing import left_over

RULE = "{id: WF-99, domain: WF, priority: high, text: t, check: CHECK, message: m}"


def run(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `pa-console` with `words` as a process; fails the test when a traceback shows."""
    command = [sys.executable, "-m", "pa_console", *words]
    done = subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=False)
    assert "Traceback" not in done.stderr + done.stdout
    return done


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["mission", "hello", "--model", "smollm"], "smollm2-135m"),
        (["mission", "hello", "--model", "missing.gguf"], "missing.gguf"),
    ],
)
def test_a_model_that_is_not_there_is_named_and_ends_with_2(
    call: Call, words: list[str], says: str
) -> None:
    done = call(*words)
    assert (done.code, done.out) == (2, "")
    assert says in done.err


def test_a_group_of_verbs_alone_shows_its_help_and_a_misspelt_one_what_is_meant(call: Call) -> None:
    alone = call("rules")
    assert (alone.code, alone.err.split()[0]) == (2, "Usage:")
    assert "See '" not in alone.err
    assert "Did you mean 'lint'? See '" in call("rules", "lnt").err


def verbs(command: object, *words: str) -> Iterator[tuple[str, ...]]:
    """Yield the words of every verb below `command`, groups included."""
    yield words
    if isinstance(command, TyperGroup):
        for name, below in command.commands.items():
            yield from verbs(below if words else load_verb(name), *words, name)


@pytest.mark.parametrize("words", verbs(get_command(app)), ids=" ".join)
def test_every_verb_has_help(call: Call, words: tuple[str, ...]) -> None:
    done = call(*words, "--help")
    assert done.code == 0
    assert " ".join(("Usage: pa-console", *words)) in done.said
    assert call(*words, "-h").out == done.out
    assert "Example: pa-console " in done.said


@pytest.mark.parametrize("name", VERBS)
def test_the_help_says_of_a_verb_what_it_says_of_itself(name: str) -> None:
    assert load_verb(name).get_short_help_str(limit=500) == VERBS[name]


def test_a_list_of_verbs_says_each_line_to_its_end_and_values_in_plain_words(call: Call) -> None:
    whole = call("--help").said
    assert all(line in whole for line in VERBS.values())
    rules = call("rules", "--help").said
    assert "priority, text, and whether a rule is checked or only judged." in rules
    options = call("mission", "--help").said
    assert "--seed NUMBER" in options
    assert "--log PATH" in options
    assert "--override-reason TEXT" in options
    assert "--approve <ask|auto|never>" in options


@pytest.mark.parametrize("example", EXAMPLES.values())
def test_every_example_is_a_call_that_the_verb_takes(example: str) -> None:
    assert not left_over(example)


def test_a_model_can_be_fetched_and_prepared_later(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fetched = tmp_path / "fetched.gguf"
    fetched.write_bytes(b"no weights that could be prepared")

    def fetch(_entry: object, _progress: object) -> Path:
        return fetched

    monkeypatch.setattr(models, "fetch", fetch)
    done = call("models", "pull", "--fetch-only")
    assert (done.code, done.out) == (0, f"{fetched}\n")


def test_the_shell_is_told_what_verbs_there_are() -> None:
    asked = {"_PA_CONSOLE_COMPLETE": "complete_bash", "COMP_WORDS": "pa-console set"}
    command = [sys.executable, "-m", "pa_console"]
    done = subprocess.run(
        command, env={**os.environ, **asked, "COMP_CWORD": "1"}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.stdout.split() == ["settings"]


def test_the_version_is_told(call: Call) -> None:
    assert call("--version").out == f"pa-console {__version__}\n"


def test_the_installed_rules_are_listed_and_right(call: Call) -> None:
    assert len(call("rules", "list", "--json").json) == 35
    checked = call("rules", "check", "--json").json
    assert checked["rules"] == 35
    assert checked["seal"]["version"]
    assert checked["wrong"] == []


@pytest.mark.parametrize(
    ("check", "says"), [("timeline.gates.all(", "check"), ("moon.full", "moon"), ("1 +", "check")]
)
def test_a_broken_rule_file_is_refused_with_line_and_field(
    call: Call, tmp_path: Path, check: str, says: str
) -> None:
    path = tmp_path / "rules.yaml"
    path.write_text(f"name: broken\nrules:\n  - {RULE.replace('CHECK', repr(check))}\n")
    done = call("rules", "check", str(path))
    assert done.code == 2
    assert f"{path}:3" in done.err
    assert says in done.err


def test_search_prints_pinned_rules_and_the_top_ones_with_scores(call: Call) -> None:
    hits = call("rules", "search", "who watches the gate", "--json").json
    pinned = [hit["rule_id"] for hit in hits if hit["pinned"]]
    assert "ROE-01" in pinned
    assert len(hits) == len(pinned) + 3
    assert all(set(hit["components"]) == {"words", "related"} for hit in hits)


def test_the_paper_s_way_of_search_can_still_be_asked_for(call: Call) -> None:
    found = call("rules", "search", "who watches the gate", "--json", "--retriever", "paper")
    assert all(set(hit["components"]) == {"fuzzy", "jaccard"} for hit in found.json)


def test_the_catalogue_names_licence_and_hash(call: Call) -> None:
    models = call("models", "list", "--json").json
    assert sum(entry["default"] for entry in models) == 1
    assert all(entry["licence"] for entry in models)


def test_the_verbs_work_from_any_folder(tmp_path: Path) -> None:
    assert run("rules", "list", cwd=tmp_path).returncode == 0
    wrong = run("nonsense", cwd=tmp_path)
    assert (wrong.returncode, wrong.stdout) == (2, "")


@pytest.mark.parametrize(
    ("fault", "remedy"),
    [(errno.EROFS, "set XDG_STATE_HOME"), (errno.ENOSPC, "free some space on that disk")],
)
def test_a_folder_that_takes_no_file_is_named_with_the_way_out(
    call: Call, monkeypatch: pytest.MonkeyPatch, fault: int, remedy: str
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(fault, os.strerror(fault), "/state")

    monkeypatch.setattr("pa_console.policy.pinned_rules.make_private_folder", full)
    done = call("mission", "Send Drone_T04 to EastGate.", "--approve", "never")
    assert done.code == 1
    assert "error: /state: " in done.said
    assert remedy in done.said.replace("\n", " ")
