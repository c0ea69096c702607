"""How far an export is, on a terminal; nothing is shown elsewhere."""

import sys

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from pa_console.cli.live_bar import LiveBar


class ExportBar(LiveBar):
    """Counts what is done; it keeps to the stderr that it began with, whoever captures it."""

    def __init__(self, what: str, total: int) -> None:
        """Show `what` is being done, up to `total`."""
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=Console(file=sys.stderr),
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
            disable=not sys.stderr.isatty(),
        )
        self._task = self._progress.add_task(what, total=total)

    def advance(self, count: int) -> None:
        """Count so many more."""
        self._progress.advance(self._task, count)
