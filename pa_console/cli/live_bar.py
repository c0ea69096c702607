"""A progress bar that lives as long as its `with` block."""

import sys
from types import TracebackType
from typing import Self

from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn

from pa_console.tui.plain_console import PlainConsole


class LiveBar:
    """What counts something on a bar; whoever derives from it makes `_progress`."""

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
    """Return a bar with what is `counted`, gone once it has stopped, on a terminal only.

    It keeps to the stderr that it began with, whoever captures that.
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
