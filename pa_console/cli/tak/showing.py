"""Sends a session to a TAK server until it ends, and reports the progress."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from pa_console.cli.output import errors
from pa_console.cli.tak.followed import Followed, joined, recorded
from pa_console.cli.tak.placing import placed
from pa_console.end_signals import end_signals, exit_code_of
from pa_console.settings.sources import Loaded
from pa_console.tak.connection import Certificate, TakConnection, TakServer
from pa_console.tak.session_on_map import SessionOnMap
from pa_console.tak.site_on_map import site_name


@dataclass(frozen=True)
class Asked:
    """The options of the verb: session and server; one of `join` and `replay`."""

    server: str
    tls: tuple[Path | None, Path | None, Path | None]
    join: str
    certificates: Path | None
    replay: str
    speed: float
    world: str | None
    origin: str
    name: str | None
    every: float


def show(asked: Asked, settings: Loaded) -> int:
    """Send the session until it ends; return the exit code.

    Raises ValueError for what cannot be followed, placed or sent to, LogError for a bad log.
    """
    server = TakServer.parse(asked.server, Certificate.of(*asked.tls))
    name = site_name(asked.name) if asked.name is not None else ""
    with _opened(asked, settings) as found:
        site = placed(found.world, asked.origin, name, replay=bool(asked.replay))
        connection = TakConnection(server, site.uid("station"), tell)
        pace = asked.speed if asked.replay else 1.0
        shown = SessionOnMap(site, connection, asked.every, pace)
        if server.open_to_all:
            tell(f"warning: {server.warning}")
        return _run(found, shown, connection)


def _opened(asked: Asked, settings: Loaded) -> AbstractContextManager[Followed]:
    if asked.replay:
        return nullcontext(recorded(asked.replay, asked.world, asked.speed, settings))
    world = asked.world or settings.values.world
    return joined(asked.join, asked.certificates, world, settings, tell)


def _run(found: Followed, shown: SessionOnMap, connection: TakConnection) -> int:
    over, ended_by = Event(), 0

    def end(number: int) -> None:
        nonlocal ended_by
        ended_by = number
        over.set()

    try:
        with end_signals(end), connection:
            tell(f"{found.title}; Ctrl-C ends it")
            try:
                for event in found.events(over.is_set):
                    if event is not None:
                        shown.take(event)
            finally:
                shown.end()
    finally:
        tell(connection.words)
    return exit_code_of(ended_by) if ended_by else 0


def tell(line: str) -> None:
    """Print one line on stderr."""
    errors.print(line, markup=False, highlight=False, soft_wrap=True)
