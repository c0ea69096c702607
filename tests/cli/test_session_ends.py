"""A session that is ended from outside ends in order: its log is whole, its assets are safe."""

import os
import pty
import signal
import subprocess
import sys
from pathlib import Path
from time import monotonic

import pytest

from pa_console.cli.main import INTERRUPTED
from pa_console.station.assembly import load_site
from tests.cli.inside import Call
from tests.cli.outside import WITHIN_S, Outside, Start
from tests.cli.test_replay_verb import record

pytestmark = pytest.mark.long

ORDER = "Fill the gap at EastGate."
LAST = ("command_sent", "session_ended")
READ_S = 1.0
"""Keys that come sooner are not heeded: nobody has read the plan yet."""
QUICK = ("--set", "approval_delay_s=0.2")


def _events(program: Outside) -> list[str]:
    return [kind for kind in program.kinds if kind not in ("log_signed", "telemetry")]


def set_moving(console: Outside) -> None:
    """Have an asset move."""
    console.until("telemetry")
    console.type(f"{ORDER}\r")
    console.until("approval_requested")
    pressed = monotonic()

    def approve() -> None:
        nonlocal pressed
        if monotonic() - pressed > READ_S:
            console.type("a\r")
            pressed = monotonic()

    console.until("command_replied", approve)


@pytest.mark.parametrize(
    ("how", "code", "reason"),
    [("SIGTERM", 143, "SIGTERM"), ("hang-up", 129, "the terminal is gone")],
)
def test_a_console_that_is_ended_from_outside_brings_its_assets_to_safety_first(
    start: Start, call: Call, how: str, code: int, reason: str
) -> None:
    console = start(*QUICK, "console", "--no-alarms", terminal=True)
    set_moving(console)
    if how == "SIGTERM":
        console.process.send_signal(signal.SIGTERM)
    else:
        console.hang_up()
    assert console.process.wait(WITHIN_S) == code
    assert _events(console)[-2:] == list(LAST)
    hold, end = [record["data"] for record in console.records if record["kind"] in LAST][-2:]
    assert hold["command"]["agent"] == "Drone_T04"
    assert hold["command"]["verb"] == "hold"
    assert reason in end["reason"]
    assert call("replay", str(console.log), "--verify").code == 0


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129),
                                              (signal.SIGINT, INTERRUPTED)])  # fmt: skip
def test_a_mission_that_is_ended_from_outside_ends_its_session(
    start: Start, call: Call, number: signal.Signals, code: int
) -> None:
    mission = start("mission", ORDER, "--json", answers="none")
    mission.until("mission_received")
    mission.process.send_signal(number)
    printed, told = mission.process.communicate(timeout=WITHIN_S)
    assert mission.process.returncode == code
    assert printed == b""
    assert b"Traceback" not in told
    assert _events(mission)[-1] == "session_ended"
    assert call("replay", str(mission.log), "--verify").code == 0


@pytest.mark.parametrize("how", ["SIGTERM", "hang-up"])
def test_a_mission_ends_while_it_asks_on_the_terminal(start: Start, call: Call, how: str) -> None:
    mission = start("--set", "standing_confidence=0", "mission", ORDER, terminal=True)
    mission.until_shown("Approve?")
    if how == "SIGTERM":
        mission.process.send_signal(signal.SIGTERM)
    else:
        mission.hang_up()
    assert mission.process.wait(WITHIN_S) == (143 if how == "SIGTERM" else 129)
    assert "command_sent" not in mission.kinds
    assert _events(mission)[-1] == "session_ended"
    assert call("replay", str(mission.log), "--verify").code == 0


def test_a_second_signal_does_not_wait_for_the_session_to_end(start: Start) -> None:
    mission = start("mission", ORDER, answers="never-closed")
    mission.until("mission_received")
    mission.process.send_signal(signal.SIGTERM)
    mission.until("session_ended")
    mission.process.send_signal(signal.SIGTERM)
    assert mission.process.wait(WITHIN_S) == -signal.SIGTERM


def test_a_session_under_nohup_outlives_its_terminal(start: Start) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        mission = start("mission", ORDER, answers="none")
    finally:
        signal.signal(signal.SIGHUP, before)
    mission.until("mission_received")
    mission.process.send_signal(signal.SIGHUP)
    mission.process.send_signal(signal.SIGTERM)
    assert mission.process.wait(WITHIN_S) == 143


def test_a_console_ends_with_its_terminal(tmp_path: Path) -> None:
    log = tmp_path / "session.jsonl"
    record(load_site("checkpoint", "checkpoint"), log)
    ours, its = pty.openpty()
    command = "from pa_console.cli.main import main; main()"
    console = subprocess.Popen(
        [sys.executable, "-c", command, "replay", str(log)],
        stdin=its,
        stdout=its,
        stderr=its,
        start_new_session=True,  # so that no terminal controls it, and no SIGHUP comes
        env={**os.environ, "TERM": "xterm-256color", "COLUMNS": "120", "LINES": "36"},
    )
    os.close(its)
    try:
        shown = b""
        while b"REPLAY" not in shown:
            shown += os.read(ours, 65536)  # raises OSError when the console ends of itself
        os.close(ours)
        console.wait(WITHIN_S)
    finally:
        console.kill()
