"""How far an export is, on a terminal; nothing is shown elsewhere."""

from rich.progress import MofNCompleteColumn

from pa_console.cli.live_bar import LiveBar, transient_bar


class ExportBar(LiveBar):
    """Counts what is done."""

    def __init__(self, what: str, total: int) -> None:
        """Show `what` is being done, up to `total`."""
        self._progress = transient_bar(MofNCompleteColumn())
        self._task = self._progress.add_task(what, total=total)

    def advance(self, count: int) -> None:
        """Count so many more."""
        self._progress.advance(self._task, count)
