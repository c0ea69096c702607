"""Keeps the signed head beside a log up to date without making who writes the log wait."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from pa_console.session.head import Head, write_head


class HeadKeeper:
    """Writes heads in a thread of its own, each once the records it speaks of are on the disk.

    A disk may take a second for that; the console's screen stands still as long as its log waits.
    """

    def __init__(
        self, log: Path, sync: Callable[[], None], seen: Callable[[Head, bool], None]
    ) -> None:
        """`sync` waits until the disk has what was written to `log`; it raises OSError.

        `seen` is given every head whose records are on the disk, and whether somebody waited.
        """
        self._log, self._sync, self._seen = log, sync, seen
        self._thread = ThreadPoolExecutor(1, "log-head")
        self._writing: Future[None] | None = None

    def keep(self, head: Head) -> None:
        """Write `head` soon, or not at all while an earlier one is written: the next says more.

        Raises the OSError that the last one ended with.
        """
        before = self._writing
        if before is not None and not before.done():
            return
        self._writing = self._thread.submit(self._write, head)
        if before is not None:
            before.result()

    def keep_now(self, head: Head) -> None:
        """Write `head`, whose records are on the disk, and make its name safe; raises OSError."""
        self._wait()
        self._seen(head, True)
        write_head(self._log, head, lasting=True)

    def close(self) -> None:
        """Wait for a head that is being written, and write no other."""
        self._wait()
        self._thread.shutdown()

    def _wait(self) -> None:
        """Wait for a head that is being written; how that ended does not matter any more."""
        if self._writing is not None:
            self._writing.exception()
            self._writing = None

    def _write(self, head: Head) -> None:
        self._sync()
        self._seen(head, False)
        write_head(self._log, head, lasting=False)
