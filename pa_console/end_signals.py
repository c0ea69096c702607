"""Signals that end a session from outside: SIGTERM, and SIGHUP when the terminal is gone."""

import asyncio
import os
import signal
import stat
from collections.abc import Callable, Coroutine, Generator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TypeVar

T = TypeVar("T")
ENDING = (signal.SIGTERM, signal.SIGHUP)
HEED_S = 0.5
"""The longest delay, in seconds, of a signal that arrives while the terminal is read."""


@contextmanager
def end_signals(end: Callable[[int], None]) -> Generator[None]:
    """Call `end` with the number of the first signal; a second signal ends the process.

    A signal that is already ignored stays ignored, so that `nohup` lets a session outlive its
    terminal. `end` is called between two steps of the main thread.
    """
    before = {number: signal.getsignal(number) for number in ENDING}
    heeded = [number for number, handler in before.items() if handler is not signal.SIG_IGN]

    def heed(number: int, _: FrameType | None) -> None:
        for each in heeded:
            signal.signal(each, signal.SIG_DFL)
        if number == signal.SIGHUP:
            leave_terminal()
        end(number)

    for number in heeded:
        signal.signal(number, heed)
    try:
        yield
    finally:
        for number in heeded:
            signal.signal(number, before[number])


def leave_terminal() -> None:
    """Redirect standard streams from the lost terminal, where writing fails, to the null device."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in range(3):
        with suppress(OSError):  # the stream is closed
            if stat.S_ISCHR(os.fstat(number).st_mode):  # isatty() is false for a lost terminal
                os.dup2(nowhere, number)
    os.close(nowhere)


def exit_code_of(number: int) -> int:
    """Return the exit code that shells report for a process ended by the signal `number`."""
    return 128 + number


class EndableRun:
    """A run of a session without a screen; `end` ends the session in an orderly way."""

    def __init__(self) -> None:
        self.ended_by = 0
        """The number of the signal that `end` was called with; 0 if it was not called."""
        self.cancel: Callable[[], object] = lambda: None
        """A function that ends the running session; a session may replace it with its own."""
        self._asking = False

    def run(
        self, session: Coroutine[None, None, T], loop: asyncio.Runner | None = None
    ) -> T | None:
        """Run `session` and return its result; None if `end` ended it.

        The session runs in `loop`; without one, in a new event loop.
        """
        try:
            main = self._main(session)
            return asyncio.run(main) if loop is None else loop.run(main)
        except (asyncio.CancelledError, KeyboardInterrupt):
            if not self.ended_by:
                raise
            return None

    @contextmanager
    def asking(self) -> Generator[None]:
        """Let `end` interrupt the block at once, because nothing else runs while the block waits.

        A signal that arrives just before the terminal is read would be handled only after the
        answer, so a timer interrupts the reading from time to time.
        """
        before = signal.signal(signal.SIGALRM, self._heed)
        signal.setitimer(signal.ITIMER_REAL, HEED_S, HEED_S)
        self._asking = True
        try:
            yield
        finally:
            self._asking = False
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)

    def _heed(self, _number: int, _: FrameType | None) -> None:
        if self.ended_by:
            _interrupt()

    def end(self, number: int) -> None:
        """End the session because of the signal `number`; a session that is over is unaffected."""
        self.ended_by = number
        if self._asking:
            _interrupt()
        self.cancel()

    async def _main(self, session: Coroutine[None, None, T]) -> T:
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None
        self.cancel = lambda: loop.call_soon_threadsafe(task.cancel)
        if self.ended_by:  # before the session began
            task.cancel()
        try:
            return await session
        finally:
            self.cancel = lambda: None


def _interrupt() -> None:
    raise KeyboardInterrupt
