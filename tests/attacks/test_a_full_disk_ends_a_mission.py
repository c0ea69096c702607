"""A mission without a screen whose log cannot be written ends at once, with the reason."""

import json
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from pa_console.session.log.verification import verify

PROBE = """
import resource, sys
from pathlib import Path
from pa_console.cli.sessions import mission as mission_session
from pa_console.cli.main import main
from tests.scripted import ScriptedEngine, plan

engine = ScriptedEngine([plan(("Drone_T04", "move_to EastGate"))])
mission_session.find_model = lambda *_, **_reader: engine.model
mission_session.Engine = lambda _, **_options: engine
size = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
main()
"""


@pytest.mark.skipif(not hasattr(resource, "RLIMIT_FSIZE"), reason="no limit on files here")
@pytest.mark.parametrize("size", [3_000, 12_000, 30_000, 50_000, 60_000])
def test_a_log_without_room_ends_the_session(tmp_path: Path, size: int) -> None:
    """It has a red line on stderr and in the document of --json, and nothing counts as done."""
    log = tmp_path / "s.jsonl"
    words = (
        *("--set", "standing_confidence=0", "mission", "Fill the gap at EastGate."),
        *("--approve", "auto", "--json", "--log", str(log)),
    )
    done = subprocess.run(
        [sys.executable, "-c", PROBE, str(size), *words],
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 2, done.stderr
    assert "cannot write the session log" in done.stderr
    assert "Traceback" not in done.stderr
    whole = log.read_bytes().rpartition(b"\n")[0].splitlines()
    kinds = [json.loads(line)["kind"] for line in whole]
    told = json.loads(done.stdout)
    assert (told["exit_code"], told["log"]) == (2, str(log))
    assert "cannot write the session log" in told["log_problem"]
    missions = told.get("missions", [told.get("mission")])
    assert [m["status"] is not None for m in missions] == ["mission_finished" in kinds] * len(
        missions
    )
    assert verify(log).damage in (None, "half-line")
    assert verify(log).lines == len(kinds)
    for at, kind in enumerate(kinds):
        assert kind != "command_sent" or "decision_made" in kinds[:at]
