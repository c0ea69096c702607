"""Progress bars that live as long as their `with` block."""

import sys
from types import TracebackType
from typing import Self

from rich.progress import (
    BarColumn,
    DownloadColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
)

from pa_console.terminal.output import PlainConsole


class LiveBar:
    """A progress bar; subclasses create `_progress`."""

    _progress: Progress

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._progress.stop()


class TransientBar(LiveBar):
    """A bar on a terminal only, gone once it has stopped; it counts things, or `of_bytes`.

    It keeps to the stderr that it began with, even if that is captured later.
    """

    def __init__(self, what: str, total: int | None = None, *, of_bytes: bool = False) -> None:
        """Show `what` is being done, up to `total`, if that is known yet."""
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=24),
            DownloadColumn() if of_bytes else MofNCompleteColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=PlainConsole(file=sys.stderr),
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
            disable=not sys.stderr.isatty(),
        )
        self._task = self._progress.add_task(what, total=total)

    def show(self, done: int, total: int) -> None:
        """Show that `done` of `total` are done."""
        self._progress.update(self._task, completed=done, total=total)

    def advance(self, count: int = 1) -> None:
        """Count that many more."""
        self._progress.advance(self._task, count)
