"""A mission without a screen whose log cannot be written ends at once, with the reason."""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

PROBE = """
import resource, sys
from pathlib import Path
from pa_console.cli import mission
from pa_console.cli.main import main
from tests.scripted import ScriptedEngine, plan

engine = ScriptedEngine([plan(("Drone_T04", "move_to EastGate"))])
mission.find_model = lambda *_: engine.model
mission.Engine = lambda _: engine
size = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
main()
"""


@pytest.mark.skipif(not hasattr(resource, "RLIMIT_FSIZE"), reason="no limit on files here")
@pytest.mark.parametrize("size", [3_000, 12_000, 30_000, 60_000])
def test_a_log_without_room_ends_the_session(tmp_path: Path, size: int) -> None:
    log = tmp_path / "s.jsonl"
    words = [
        "--set",
        "standing_confidence=0",
        "mission",
        "Fill the gap at EastGate.",
        "--approve",
        "auto",
        "--log",
        str(log),
    ]
    done = subprocess.run(
        [sys.executable, "-c", PROBE, str(size), *words],
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "PA_CONSOLE_SIGNING_KEY": str(tmp_path / "k" / "key.pem")},
    )
    assert done.returncode == 2, done.stderr
    assert "cannot write the session log" in done.stderr
    assert "Traceback" not in done.stderr
    whole = log.read_bytes().rpartition(b"\n")[0].splitlines()
    kinds = [json.loads(line)["kind"] for line in whole]
    for at, kind in enumerate(kinds):
        assert kind != "command_sent" or "decision_made" in kinds[:at]
