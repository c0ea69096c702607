"""What a second client of a TAK server says, and a session that hears it."""

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

from pa_console.schema.base import Point
from pa_console.schema.events.event import Event
from pa_console.session.state import SessionState
from pa_console.tak.connection import TakConnection, TakServer
from pa_console.tak.cot_event import CotEvent, element
from pa_console.tak.reports import TakReports
from pa_console.tak.session_on_map import SiteOnMap
from tests.tak.taky_server import LIMIT_S

RETRY_S = 0.05


def said(
    site: SiteOnMap,
    uid: str,
    type_: str,
    at: Point,
    callsign: str = "",
    *,
    stale_s: float = 60.0,
    now: datetime | None = None,
) -> CotEvent:
    """Return what a client says of a thing that is at a point of the site, in metres."""
    now = now or datetime.now(UTC)
    detail = (element("contact", {"callsign": callsign}),) if callsign else ()
    stale = now + timedelta(seconds=stale_s)
    return CotEvent(uid, type_, now, stale, site.point(at, 5.0), detail=detail)


class HearingSession:
    """Folds what a connection reports, as a station and its screens do."""

    def __init__(self, reports: TakReports, connection: TakConnection) -> None:
        self.reports, self.connection = reports, connection
        self.state = SessionState()
        self.events: list[Event] = []

    def take(self) -> None:
        """Take in what is new."""
        for data in self.reports.news():
            event = Event(t=datetime.now(UTC), tick=len(self.events), data=data)
            self.events.append(event)
            self.state.apply(event)

    def wait(self, done: Callable[[SessionState], object], again: Callable[[], object]) -> None:
        """Take in what comes until `done` says so; `again` is called meanwhile."""
        end = time.monotonic() + LIMIT_S
        while not done(self.state):
            assert time.monotonic() < end, self.lines
            again()
            self.take()
            time.sleep(0.02)

    @property
    def lines(self) -> list[str]:
        """The event list."""
        return [f"{notice.level} {notice.subject} {notice.text}" for notice in self.state.notices]


@contextmanager
def hearing(site: SiteOnMap, url: str) -> Generator[HearingSession]:
    """Yield a session that is connected to a server."""
    reports = TakReports(site, url)
    server = TakServer.parse(url)
    station = site.uid("station")
    with TakConnection(server, station, lambda _: None, RETRY_S, reports) as connection:
        session = HearingSession(reports, connection)
        session.wait(lambda state: state.tak.connection, lambda: None)
        yield session


def nothing() -> None:
    """Do nothing meanwhile."""
