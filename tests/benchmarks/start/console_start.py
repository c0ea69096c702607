"""Starts a console in a pseudo-terminal and notes when its screen shows what."""

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
from collections.abc import Mapping, Sequence
from contextlib import suppress
from time import perf_counter
from typing import Self

COMMAND = (sys.executable, "-P", "-m", "pa_console")
COMPILED = {"PYTHONDONTWRITEBYTECODE": ""}
"""The environment in which Python keeps what it has compiled, as it does for users. Without that
every start would compile all modules again."""

SIZE = (36, 120)
"""Rows and columns of the terminal."""

LIMIT_S = 60.0
"""A text that the console has not shown by then fails the measurement."""

END_S = 5.0
TAIL = 2000
"""Characters at the end of what was shown that may be the beginning of a text looked for."""

_CONTROL = re.compile(
    r"\x1b(?:\][^\x07\x1b]*(?:\x07|\x1b\\)|\[[0-?]*[ -/]*[@-~]|P[^\x1b]*\x1b\\|.)"
)


class StartError(RuntimeError):
    """The program did not come up; says what it showed last."""


class ConsoleStart:
    """A console that is coming up; its clock runs from before its process is made."""

    def __init__(self, words: Sequence[str], environment: Mapping[str, str]) -> None:
        """Start `pa-console` with `words`; `environment` is added to that of this process."""
        self._terminal, its = pty.openpty()
        fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", *SIZE, 0, 0))
        self._shown = ""
        self._started = perf_counter()
        try:
            self._process = subprocess.Popen(
                [*COMMAND, *words],
                stdin=its,
                stdout=its,
                stderr=its,
                env={**os.environ, **COMPILED, "TERM": "xterm-256color", **environment},
                start_new_session=True,
            )
        except BaseException:
            os.close(self._terminal)
            raise
        finally:
            os.close(its)

    def wait_for(self, text: re.Pattern[str]) -> float:
        """Return the seconds from the start until the screen has shown `text`.

        Raises StartError when the console ends before, or does not show it within LIMIT_S.
        """
        while not text.search(_CONTROL.sub("", self._shown)):
            self._shown = self._shown[-TAIL:] + self._read()
        return perf_counter() - self._started

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End the console in order; kill it when it does not end within END_S."""
        try:
            self._process.terminate()
            self._drain(perf_counter() + END_S)
        finally:
            self._process.kill()
            self._process.wait()
            os.close(self._terminal)

    def _read(self) -> str:
        """Return what the console writes next."""
        left = self._started + LIMIT_S - perf_counter()
        written = b""
        if left > 0 and select.select([self._terminal], [], [], left)[0]:
            with suppress(OSError):  # nobody is at the other end any more
                written = os.read(self._terminal, 65536)
        if not written:
            seen = " ".join(_CONTROL.sub("", self._shown).split())
            raise StartError(f"the console did not come up; it showed last: {seen[-300:]}")
        return written.decode("utf-8", "replace")

    def _drain(self, until: float) -> None:
        """Read whatever the console still writes, so that it can end, and wait for its end."""
        while self._process.poll() is None and (left := until - perf_counter()) > 0:
            if select.select([self._terminal], [], [], min(left, 0.05))[0]:
                with suppress(OSError):
                    os.read(self._terminal, 65536)
