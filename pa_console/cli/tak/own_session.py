"""Shows the session of a verb on the map of a TAK server, as an observer of its events."""

from collections.abc import Callable, Generator
from contextlib import contextmanager

from pa_console.cli.tak.placing import placed
from pa_console.observability.observers import Observer
from pa_console.orchestrator.station.assembly import open_world
from pa_console.settings.schema import Settings
from pa_console.tak.background import InBackground
from pa_console.tak.connection import TakConnection
from pa_console.tak.server import Certificate, TakServer
from pa_console.tak.session_on_map import SessionOnMap


@contextmanager
def on_map(
    settings: Settings, world: str, tell: Callable[[str], None], say: Callable[[str], None]
) -> Generator[Observer]:
    """Give what shows events on the map; `tell` is told at the end of what was not shown.

    `say` is told of the connection, whenever that changes, in another thread.

    Raises ValueError for a server, a certificate or an origin that cannot be used.
    """
    certificate = Certificate.of(settings.tak_certificate, settings.tak_key, settings.tak_authority)
    server = TakServer.parse(settings.tak, certificate)
    site = placed(open_world(world)[0], settings.tak_origin)
    state = ""

    def changed(line: str) -> None:
        nonlocal state
        state = line
        say(f"TAK map: {line}")

    if server.open_to_all:
        tell(server.warning)
    connection = TakConnection(server, site.uid("station"), changed)
    try:
        with connection:
            shown = SessionOnMap(site, connection)
            try:
                with InBackground(shown.take, tell) as showing:
                    yield showing.take
            finally:
                shown.end()
    finally:
        if connection.waiting or connection.dropped:
            tell(f"TAK map: {state}; {connection.words}")
