"""What every export begins and ends with: the log that is read, and where the result is."""

from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.output import errors, out
from pa_console.export.opening import OpenedSession, open_session

LogArgument = Annotated[Path, typer.Argument(help="A session log (JSONL).")]
SessionWorld = Annotated[
    str | None, typer.Option("--world", help="The session's world, when it is a file.")
]
SessionRules = Annotated[
    str | None, typer.Option("--rules", help="The session's rules, when they are a file.")
]


def opened(log: Path) -> OpenedSession:
    """Read the log, and say on stderr when it could not be read to its end."""
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
    """Say where the export is."""
    out.print(f"{target}: {what}", markup=False, soft_wrap=True)
