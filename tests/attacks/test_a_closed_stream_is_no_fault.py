"""A program that was started without standard input asks nobody, says so, and does nothing."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from pa_console.station.assembly import load_site
from tests.cli.inside import Call
from tests.cli.test_replay_verb import record
from tests.scripted import ScriptedEngine

RUN = "from pa_console.cli.main import main; main()"
CLOSED = {"in": "<&-", "out": ">&-", "all": "<&- >&- 2>&-"}


@pytest.fixture(autouse=True)
def _closed_input(engine: ScriptedEngine, monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    for name in ("stdin", "__stdin__"):
        monkeypatch.setattr(sys, name, None)


def test_a_mission_that_nobody_can_approve_is_rejected(call: Call, tmp_path: Path) -> None:
    log = tmp_path / "session.jsonl"
    done = call("mission", "Fill the gap.", "--log", str(log))
    assert done.code == 3
    assert "no answer at the terminal" in done.said
    assert '"command_sent"' not in log.read_text()


def test_the_console_says_that_no_key_would_arrive(
    call: Call, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("pa_console.session.log.writer.default_folder", lambda: tmp_path / "logs")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    done = call("console")
    assert done.code == 2
    assert "standard input is not a terminal" in done.err
    assert not (tmp_path / "logs").exists(), "a session that nobody can command is not begun"


def shell(redirections: str, *words: str) -> tuple[str, ...]:
    """Return the command that runs a verb with its streams redirected."""
    return ("sh", "-c", f'exec "$@" {redirections}', "sh", sys.executable, "-c", RUN, *words)


def test_a_replay_on_a_terminal_without_keys_says_so(tmp_path: Path) -> None:
    log = tmp_path / "session.jsonl"
    record(load_site("checkpoint", "checkpoint"), log)
    ours, its = pty.openpty()
    replay = subprocess.Popen(
        shell("<&-", "replay", str(log)), stdout=its, stderr=its, start_new_session=True
    )
    os.close(its)
    said = b""
    try:
        while chunk := os.read(ours, 65536):
            said += chunk
    except OSError:  # the other end of a terminal is closed
        pass
    finally:
        os.close(ours)
    assert replay.wait() == 2
    assert b"standard input is not a terminal" in said
    assert b"Traceback" not in said
    assert b"Error" not in said


@pytest.mark.parametrize("closed", CLOSED)
def test_verbs_that_need_no_stream_work_without_it(closed: str) -> None:
    command = shell(CLOSED[closed], "scenarios", "list")
    listed = subprocess.run(command, capture_output=True, check=False)
    assert (listed.returncode, listed.stderr) == (0, b"")
    assert (b"situation-2" in listed.stdout) == (closed == "in")
