"""Shows the session of a verb on the map of a TAK server, and receives reports from there."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass

from pa_console.observability import Observer
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.geography import geography_of
from pa_console.station.assembly import open_world
from pa_console.tak.connection import Certificate, TakConnection, TakServer
from pa_console.tak.reports import TakReports
from pa_console.tak.session_on_map import InBackground, SessionOnMap, SiteOnMap


@dataclass(frozen=True)
class OnMap:
    """The two directions of a TAK connection: events to the map, and reports from it."""

    take: Observer
    reports: TakReports


@contextmanager
def on_map(
    settings: Settings, world: str, tell: Callable[[str], None], say: Callable[[str], None]
) -> Generator[OnMap]:
    """Connect to the TAK server of `settings` and yield both directions.

    At the end, `tell` gets a warning if events were not shown. `say` gets each change of the
    connection, from another thread.

    Raises ValueError for an unusable server, certificate or origin.
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
    contacts = settings.tak_contacts
    reports = TakReports(
        site, str(server), contacts=not server.open_to_all if contacts is None else contacts
    )
    connection = TakConnection(server, site.uid("station"), changed, reports=reports)
    try:
        with connection:
            shown = SessionOnMap(site, connection)
            try:
                with InBackground(shown.take, tell) as showing:
                    yield OnMap(showing.take, reports)
            finally:
                shown.end()
    finally:
        if connection.outbox or connection.outbox.dropped:
            tell(f"TAK map: {state}; {connection.words}")


def placed(world: World, origin: str, name: str = "", *, replay: bool = False) -> SiteOnMap:
    """Return the site, named `name` or after the world; `origin` overrides the world's file.

    Raises ValueError for an invalid origin or name, and for a world without a place on the earth.
    """
    geography = geography_of(world, origin, "--origin, --tak-origin")
    return SiteOnMap(world, geography, name or world.name, replay)
