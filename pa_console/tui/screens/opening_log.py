"""A session log that takes long to open is read beside the screen, with a bar of how far it is."""

from collections.abc import Callable
from pathlib import Path
from threading import Event
from typing import Generic, TypeVar

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import ProgressBar, Static

from pa_console.schema.document import DocumentError
from pa_console.session.log_index import Progress
from pa_console.session.recording import CACHED_FROM

Opened = TypeVar("Opened")
LARGE = CACHED_FROM
"""The size from which the index of a log is kept: building it takes a second or longer."""


class _LeftError(Exception):
    """The log is not wanted any more."""


def is_large(log: Path) -> bool:
    """Return whether opening `log` may take so long that it should be seen; raises OSError."""
    return log.stat().st_size >= LARGE


class OpeningLog(ModalScreen[Opened | None], Generic[Opened]):
    """Returns what `opening` makes of the log; None when it cannot be used, which is told."""

    BINDINGS = [Binding("escape,q", "leave", "Stop reading")]

    def __init__(self, log: Path, opening: Callable[[Progress], Opened]) -> None:
        """Call `opening` in a thread, with a callback for its progress, in bytes."""
        super().__init__()
        self._log, self._opening, self._left = log, opening, Event()

    def compose(self) -> ComposeResult:
        """Yield the name of the log, the bar, and how to stop."""
        with Vertical(id="reading"):
            yield Static(f"Reading {self._log.name}", markup=False)
            yield ProgressBar(id="reading-bar")
            yield Static("Esc stops reading", id="reading-note")

    def on_mount(self) -> None:
        """Read, once the screen is there."""
        self.run_worker(self._read, thread=True, exit_on_error=False)

    def on_unmount(self) -> None:
        """Let the thread end at its next step."""
        self._left.set()

    def _read(self) -> None:
        try:
            opened = self._opening(self._tell)
        except _LeftError:
            return
        except (ValueError, OSError, DocumentError) as error:
            self.app.call_from_thread(self._end, None, str(error))
        else:
            self.app.call_from_thread(self._end, opened)

    def _tell(self, done: int, total: int) -> None:
        if self._left.is_set():
            raise _LeftError
        self.app.call_from_thread(self._show, done, total)

    def _show(self, done: int, total: int) -> None:
        if self.is_attached:
            self.query_one(ProgressBar).update(total=total, progress=done)

    def _end(self, opened: Opened | None, problem: str = "") -> None:
        if self._left.is_set():
            return
        if problem:
            self.app.notify(
                problem, title="Session log", severity="error", timeout=10, markup=False
            )
        self.dismiss(opened)

    def action_leave(self) -> None:
        """Return nothing; the thread ends at its next step."""
        self._left.set()
        self.dismiss(None)
