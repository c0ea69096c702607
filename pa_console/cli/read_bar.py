"""Opens a session log with a bar that says how far it was read."""

from pathlib import Path

from rich.progress import DownloadColumn

from pa_console.cli.live_bar import LiveBar, transient_bar
from pa_console.session.recording import Recording
from pa_console.tui.recordings import index_folder


class ReadBar(LiveBar):
    """Counts the bytes of a log that were read, on a terminal."""

    def __init__(self, log: Path) -> None:
        """Show that `log` is being read."""
        self._progress = transient_bar(DownloadColumn())
        self._task = self._progress.add_task(f"reading {log.name}", total=None)

    def show(self, done: int, total: int) -> None:
        """Note that `done` of `total` bytes were read."""
        self._progress.update(self._task, completed=done, total=total)


def read_recording(log: Path) -> Recording:
    """Open `log` for a replay; raises LogError when not even one line of it is good."""
    with ReadBar(log) as bar:
        return Recording.read(log, bar.show, cache=index_folder())
