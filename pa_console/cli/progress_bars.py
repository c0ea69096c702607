"""Progress bars that are shown until the end of a `with` block."""

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
    """A progress bar that is shown only on a terminal, and is removed at the end.

    It counts items or, with `of_bytes`, bytes. It writes to the stderr that was in use when it was
    created, even if stderr is captured later.
    """

    def __init__(self, title: str, total: int | None = None, *, of_bytes: bool = False) -> None:
        """Show `title` beside the bar; `total` is None if it is not known yet."""
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
        self._task = self._progress.add_task(title, total=total)

    def show(self, done: int, total: int) -> None:
        """Set the progress to `done` of `total`."""
        self._progress.update(self._task, completed=done, total=total)

    def advance(self, count: int = 1) -> None:
        """Add `count` to the progress."""
        self._progress.advance(self._task, count)
