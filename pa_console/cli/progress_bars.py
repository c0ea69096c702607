"""Progress bars that live as long as their `with` block."""

import sys
from pathlib import Path
from types import TracebackType
from typing import Self

from rich.progress import (
    BarColumn,
    DownloadColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from pa_console.session.recording import Recording
from pa_console.terminal.output import PlainConsole
from pa_console.tui.recordings import index_folder


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


def transient_bar(counted: ProgressColumn) -> Progress:
    """Return a bar that counts `counted`, gone once it has stopped, on a terminal only.

    It keeps to the stderr that it began with, even if that is captured later.
    """
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        counted,
        TextColumn("left"),
        TimeRemainingColumn(),
        console=PlainConsole(file=sys.stderr),
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
        disable=not sys.stderr.isatty(),
    )


class LoadingBar(LiveBar):
    """Counts the bytes of a log that were read, on a terminal."""

    def __init__(self, log: Path) -> None:
        """Show that `log` is being read."""
        self._progress = transient_bar(DownloadColumn())
        self._task = self._progress.add_task(f"reading {log.name}", total=None)

    def show(self, done: int, total: int) -> None:
        """Note that `done` of `total` bytes were read."""
        self._progress.update(self._task, completed=done, total=total)


class RecordsBar(LiveBar):
    """Counts the records of a shared session that have come, on a terminal."""

    def __init__(self) -> None:
        """Show that a session is waited for."""
        self._progress = transient_bar(MofNCompleteColumn())
        self._task = self._progress.add_task("reading the session", total=None)

    def show(self, done: int, total: int) -> None:
        """Note that `done` of `total` records have come."""
        self._progress.update(self._task, completed=done, total=total)


def read_recording(log: Path) -> Recording:
    """Open `log` for a replay; raises LogError when not even one line of it is good."""
    with LoadingBar(log) as bar:
        return Recording.read(log, bar.show, cache=index_folder())


class ExportBar(LiveBar):
    """Counts the progress."""

    def __init__(self, what: str, total: int) -> None:
        """Show `what` is being done, up to `total`."""
        self._progress = transient_bar(MofNCompleteColumn())
        self._task = self._progress.add_task(what, total=total)

    def advance(self, count: int) -> None:
        """Count that many more."""
        self._progress.advance(self._task, count)
