"""A console whose terminal is gone ends, also where no signal tells it so."""

import os
import pty
import subprocess
import sys
from pathlib import Path

from pa_console.station.assembly import load_site
from tests.cli.outside import WITHIN_S
from tests.cli.test_replay_verb import record


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
