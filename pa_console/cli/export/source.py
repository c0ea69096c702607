"""The beginning and end of every export: the log to read, and the place of the result."""

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import MofNCompleteColumn

from pa_console.cli.output import errors, out
from pa_console.cli.progress_bars import LiveBar, transient_bar
from pa_console.export.source_log import OpenedSession, open_session


class ExportBar(LiveBar):
    """Counts the progress."""

    def __init__(self, what: str, total: int) -> None:
        """Show `what` is being done, up to `total`."""
        self._progress = transient_bar(MofNCompleteColumn())
        self._task = self._progress.add_task(what, total=total)

    def advance(self, count: int) -> None:
        """Count that many more."""
        self._progress.advance(self._task, count)


LogArgument = Annotated[Path, typer.Argument(help="A session log (JSONL).")]
SessionWorld = Annotated[
    str | None, typer.Option("--world", help="The session's world, when it is a file.")
]
SessionRules = Annotated[
    str | None, typer.Option("--rules", help="The session's rules, when they are a file.")
]


def opened(log: Path) -> OpenedSession:
    """Read the log, and report on stderr if it could not be read to its end."""
    with errors.status(f"reading {log.name}"):
        session = open_session(log)
    if session.recording.problem is not None:
        errors.print(
            f"note: only what comes before this is exported: {session.recording.problem}",
            style="yellow",
            markup=False,
            soft_wrap=True,
        )
    return session


def written(target: Path, what: str) -> None:
    """Report the place of the export."""
    out.print(f"{target}: {what}", markup=False, soft_wrap=True)
