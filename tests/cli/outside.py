"""Runs `pa-console` with a scripted LLM as a process, if wanted in a terminal of its own."""

import fcntl
import json
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from pa_console.signing import KEY_VARIABLE

PROGRAM = """
import asyncio, sys
from pa_console.cli.sessions import mission as mission_session, opening
from pa_console.cli.main import main
from tests.scripted import ScriptedEngine, plan

answer = sys.argv.pop(1)
moved = plan(("Drone_T04", "move_to EastGate"))
engine = ScriptedEngine([moved if answer == "plan" else None])
if answer == "never-closed":
    engine.close = asyncio.Event().wait
verbs = [opening, mission_session]
if "serve" in sys.argv:
    from pa_console.cli.sessions import served as serve_session
    verbs.append(serve_session)
for verb in verbs:
    verb.find_model = lambda *_, **_reader: engine.model
    verb.Engine = lambda _, **_options: engine
main()
"""
WITHIN_S = 300.0
"""What has not happened by then never will, also on a busy machine."""


class Outside:
    """One `pa-console`, whose session log is the only one in `logs`.

    `answers` is "plan" for a sound plan, "none" for a model that never answers, "never-closed" for
    one that cannot be closed either. With `terminal`, its streams are a terminal that controls it;
    with `piped`, lines can be typed into its standard input.
    """

    def __init__(
        self,
        folder: Path,
        *words: str,
        answers: str = "plan",
        terminal: bool = False,
        piped: bool = False,
    ) -> None:
        self.logs = folder / "logs"
        self._terminal = self._stop = -1
        self._shown = bytearray()
        environment = {
            **os.environ,
            KEY_VARIABLE: str(folder / "key" / "key.pem"),
            "TERM": "xterm-256color",
            **{f"XDG_{name}_HOME": str(folder / name) for name in ("STATE", "CONFIG", "DATA")},
        }
        command = [sys.executable, "-c", PROGRAM, answers, "--set", f"logs={self.logs}", *words]
        if not terminal:
            pipe = subprocess.PIPE
            self.process = subprocess.Popen(
                command,
                env=environment,
                stdin=pipe if piped else subprocess.DEVNULL,
                stdout=pipe,
                stderr=pipe,
            )
            return
        self._terminal, its = pty.openpty()
        fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", 36, 120, 0, 0))
        self.process = subprocess.Popen(
            command, env=environment, stdin=its, stdout=its, stderr=its, start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # noqa: PLW1509 - no threads yet
        )  # fmt: skip
        os.close(its)
        stopped, self._stop = os.pipe()
        self._reader = threading.Thread(target=self._read, args=(stopped,), daemon=True)
        self._reader.start()

    def _read(self, stopped: int) -> None:
        with suppress(OSError):  # the other end of the terminal is closed
            while stopped not in select.select([self._terminal, stopped], [], [])[0]:
                self._shown += os.read(self._terminal, 65536)
        os.close(stopped)

    @property
    def shown(self) -> str:
        """All that came to the terminal."""
        return self._shown.decode(errors="replace")

    def type(self, text: str) -> None:
        """Type on the terminal."""
        os.write(self._terminal, text.encode())

    def hang_up(self) -> None:
        """Take the terminal away, as a window that is closed does.

        A terminal that is still being read from does not go away.
        """
        os.close(self._stop)
        self._reader.join()
        os.close(self._terminal)

    @property
    def log(self) -> Path:
        """The session log; raises ValueError while there is none."""
        (log,) = self.logs.glob("*.jsonl")
        return log

    @property
    def records(self) -> list[dict[str, Any]]:
        """The whole records of the log, none while there is no log."""
        if not any(self.logs.glob("*.jsonl")):
            return []
        return [json.loads(line) for line in self.log.read_bytes().split(b"\n")[:-1]]

    @property
    def kinds(self) -> list[str]:
        """What the log tells, in order."""
        return [record["kind"] for record in self.records]

    def until(self, kind: str, meanwhile: Callable[[], object] = lambda: None) -> None:
        """Wait until the log tells of `kind`, and do something again and again meanwhile."""
        self.until_true(lambda: kind in self.kinds, meanwhile)

    def until_shown(self, text: str) -> None:
        """Wait until `text` is on the terminal."""
        self.until_shown_times(text, 1)

    def until_shown_times(self, text: str, times: int) -> None:
        """Wait until `text` has come to the terminal so many times."""
        self.until_true(lambda: self.shown.count(text) >= times)

    def until_new(self, log: Path) -> None:
        """Wait until another log than `log` tells of telemetry."""

        def told() -> bool:
            others = set(self.logs.glob("*.jsonl")) - {log}
            return any(b'"kind":"telemetry"' in other.read_bytes() for other in others)

        self.until_true(told)

    def until_true(
        self, done: Callable[[], bool], meanwhile: Callable[[], object] = lambda: None
    ) -> None:
        """Wait until something is `done`, and do something again and again meanwhile."""
        end = time.monotonic() + WITHIN_S
        while not done():
            assert self.process.poll() is None, self.shown
            assert time.monotonic() < end, self.shown
            meanwhile()
            time.sleep(0.05)

    def close(self) -> None:
        """End the process if it goes on."""
        self.process.kill()
        self.process.wait()


Start = Callable[..., Outside]
"""Starts a `pa-console` with these words and options of Outside."""
