"""Follows a session's events and tells a TAK server of them; it never delays the session."""

from collections.abc import Callable, Iterable
from datetime import UTC, datetime, timedelta
from typing import Protocol

from pa_console.schema.events.event import Event, SessionEnded, TelemetryReceived
from pa_console.tak.cot_event import CotEvent
from pa_console.tak.picture_on_map import PictureOnMap
from pa_console.tak.site_on_map import SiteOnMap

DRAWN_S = 600.0
"""The ground stays on the map for so long after it was drawn; it is drawn anew in half the time."""


class Receiver(Protocol):
    """What takes CoT events and sends them on."""

    connections: int

    def send(self, events: Iterable[CotEvent]) -> None:
        """Take `events`; returns at once."""
        ...


class SessionOnMap:
    """Gives a receiver the pictures of a session, at most one in `every_s` seconds.

    Nothing is told that is newer than this machine's clock says: whoever's clock goes ahead cannot
    make anything look fresher than it is.
    """

    def __init__(
        self,
        site: SiteOnMap,
        receiver: Receiver,
        every_s: float = 1.0,
        pace: float = 1.0,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """`pace` is how many seconds of the session pass in one of the map's."""
        self._site, self._receiver, self._now = site, receiver, now
        self._picture = PictureOnMap(site, pace)
        self._every = timedelta(seconds=min(every_s, site.world.stale_s / 2))
        self._last: datetime | None = None
        self._drawn: tuple[int, datetime] | None = None

    def take(self, event: Event) -> None:
        """Take one event of the session; only pictures and the end are told of."""
        match event.data:
            case TelemetryReceived(picture=picture):
                moment = min(event.t, self._now())
                if self._last is not None and timedelta() <= moment - self._last < self._every:
                    return
                self._last = moment
                self._receiver.send([*self._ground(moment), *self._picture.events(picture, moment)])
            case SessionEnded():
                self.end()
            case _:
                pass

    def end(self) -> None:
        """Take tracks, routes and the ground off the map; the assets go stale by themselves."""
        now = self._now()
        drawn = self._site.ground_deleted(now) if self._drawn is not None else []
        self._drawn = None
        self._receiver.send([*self._picture.deleted(now), *drawn])

    def _ground(self, now: datetime) -> list[CotEvent]:
        """Return the ground: once a connection, and again before it goes stale."""
        connections = self._receiver.connections
        if self._drawn is not None:
            before, at = self._drawn
            if before == connections and now - at < timedelta(seconds=DRAWN_S / 2):
                return []
        self._drawn = connections, now
        return self._site.ground(now, now + timedelta(seconds=DRAWN_S))
