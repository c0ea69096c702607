"""The lines that are typed while a session goes on, read in a thread of their own."""

import asyncio
import os
import select
import sys
import termios
from threading import Thread

LONGEST = 20_000
"""Bytes of a line; what is longer is cut."""


class InputLines:
    """Puts each line of standard input into `queue`; None when there will be no more.

    On a terminal the end of the input (Ctrl-D) is the line `quit`, and reading goes on for as
    long as the terminal is there.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.queue: asyncio.Queue[str | None] = asyncio.Queue()
        self._loop, self._file = loop, sys.stdin.fileno()
        self._terminal = sys.stdin.isatty()
        self._ended, self._end = os.pipe()
        self._thread = Thread(target=self._read, name="input", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def close(self) -> None:
        """Read no more."""
        os.write(self._end, b".")
        self._thread.join()
        os.close(self._end)
        os.close(self._ended)

    def forget_typed(self) -> None:
        """Drop the text typed and not yet sent: it was meant for another prompt."""
        if self._terminal:
            termios.tcflush(self._file, termios.TCIFLUSH)

    def _read(self) -> None:
        pending = b""
        while self._ended not in select.select([self._file, self._ended], [], [])[0]:
            try:
                read = os.read(self._file, 4096)
            except OSError:
                read = b""
                self._terminal = False
            if not read and self._terminal and os.isatty(self._file):
                self._give("quit")
                continue
            if not read:
                if pending:
                    self._give(pending.decode(errors="replace"))
                self._give(None)
                return
            *lines, pending = (pending + read).split(b"\n")
            pending = pending[:LONGEST]
            for line in lines:
                self._give(line[:LONGEST].decode(errors="replace"))

    def _give(self, line: str | None) -> None:
        self._loop.call_soon_threadsafe(self.queue.put_nowait, line)
