"""What the shell offers after TAB, and the version for a bug report."""

from importlib.metadata import version
from pathlib import Path

import pytest

from pa_console import __version__
from tests.cli.inside import Call


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        (["console", "--world", "ch"], "checkpoint"),
        (["console", "--rules", "ch"], "checkpoint"),
        (["console", "--scenario", "situation-2"], "situation-2"),
        (["mission", '"Send Drone_T04 to Ea'], "Send Drone_T04 to EastGate"),
        (["mission", '"Send Robot_T01'], "Send Robot_T01"),
        (["mission", "x", "--model", "smollm2-135m"], "smollm2-135m"),
        (["scenarios", "show", "situation-2"], "situation-2"),
        (["world", "check", "ch"], "checkpoint"),
        (["rules", "check", "ch"], "checkpoint"),
        (["models", "pull", "pa-5"], "pa-500m"),
        (["eval", "--missions", "fi"], "field"),
        (["eval", "--model", "pa-5"], "pa-500m"),
        (["manual", "standing"], "standing-orders"),
        (["settings", "set", "them"], "theme"),
        (["replay", "la"], "last"),
        (["export", "markdown", "la"], "last"),
    ],
)
def test_the_shell_is_offered_what_may_stand_there(
    call: Call, monkeypatch: pytest.MonkeyPatch, typed: list[str], offered: str
) -> None:
    assert offered in offers(call, monkeypatch, typed)


def test_recorded_sessions_are_offered_the_newest_first(
    call: Call, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("20261101T080000-aaaa", "20261102T080000-bbbb"):
        (tmp_path / f"{name}.jsonl").touch()
    monkeypatch.setenv("PA_CONSOLE_LOGS", str(tmp_path))
    found = offers(call, monkeypatch, ["replay", "2026"])
    assert sorted(found) == ["20261101T080000-aaaa", "20261102T080000-bbbb"]


def test_a_broken_world_or_settings_file_offers_nothing_and_reports_nothing(
    call: Call, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.yaml"
    broken.write_text("][", encoding="utf-8")
    assert offers(call, monkeypatch, ["mission", "--world", str(broken), '"Send Dr']) == []
    monkeypatch.setenv("PA_CONSOLE_SETTINGS", str(broken))
    assert offers(call, monkeypatch, ["replay", "la"]) == ["last"]


def offers(call: Call, monkeypatch: pytest.MonkeyPatch, typed: list[str]) -> list[str]:
    """Return what bash is offered for the last of the words `typed`."""
    monkeypatch.setenv("_PA_CONSOLE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "\n".join(["pa-console", *typed]))
    monkeypatch.setenv("COMP_CWORD", str(len(typed)))
    done = call()
    assert (done.code, done.err) == (0, "")
    return done.out.split("\n")[:-1] if done.out.strip() else []


def test_a_bug_report_gets_the_versions_as_json(call: Call) -> None:
    found = call("--version", "--json").json
    assert found["pa-console"] == __version__
    assert found["libraries"]["textual"] == version("textual")


def test_json_alone_is_refused(call: Call) -> None:
    done = call("--json")
    assert (done.code, done.out) == (2, "")
    assert "--version" in done.err
