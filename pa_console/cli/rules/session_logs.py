"""The session logs that a verb of `pa-console rules` goes through: files, and folders of them."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from pa_console.schema.events.event import Event, SessionStarted
from pa_console.session.log.chain import LogError, read_log

LogsArgument = Annotated[
    list[Path], typer.Argument(metavar="LOG...", help="Session logs, or folders of them.")
]


def find_logs(places: Sequence[Path]) -> list[Path]:
    """Return every session log of `places`; a folder's other files are no logs and left out.

    Raises ValueError when a place is not there, or holds no log at all.
    """
    found: list[Path] = []
    for place in places:
        if place.is_dir():
            logs = [path for path in sorted(place.rglob("*.jsonl")) if _is_log(path)]
            if not logs:
                raise ValueError(f"{place}: there is no session log in this folder")
            found += logs
        elif place.is_file():
            found.append(place)
        else:
            raise ValueError(f"{place}: there is no such log or folder")
    return list(dict.fromkeys(found))


class SessionEvents:
    """The events of a log, once; `problem` says why they end before the log does, if they do."""

    def __init__(self, log: Path) -> None:
        """Read how the session began; raises LogError for what is no session log."""
        self._events = read_log(log)
        first = next(self._events, None)
        if first is None:
            raise LogError(str(log), 1, "the log is empty")
        if not isinstance(first.data, SessionStarted):
            raise LogError(str(log), 1, "the log does not begin with the start of a session")
        self._first, self.started = first, first.data
        self.problem = ""

    def __iter__(self) -> Iterator[Event]:
        yield self._first
        try:
            yield from self._events
        except LogError as error:
            self.problem = str(error)


def _is_log(path: Path) -> bool:
    with path.open("rb") as file:
        return b'"kind":"session_started"' in file.readline(1 << 20).replace(b'": "', b'":"')
