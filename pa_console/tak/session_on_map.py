"""A session on a TAK map, drawn from its events without delaying it."""

from collections.abc import Callable, Iterable
from datetime import UTC, datetime, timedelta
from threading import Condition, Thread
from typing import Protocol, Self

from pa_console.schema.events.event import Event, SessionEnded, TelemetryReceived
from pa_console.tak.cot_event import CotEvent
from pa_console.tak.picture_on_map import PictureOnMap
from pa_console.tak.site_on_map import SiteOnMap

DRAWN_S = 600.0
"""The validity of the ground on the map; it is drawn again in half the time."""


class Receiver(Protocol):
    """A sink of CoT events, such as a connection."""

    connections: int

    def send(self, events: Iterable[CotEvent]) -> None:
        """Take `events`; return at once."""
        ...


class SessionOnMap:
    """The source of a receiver's events: the pictures of a session, one in `every_s` at most.

    An event is never newer than this machine's clock, so that a station's fast clock cannot make a
    report look fresh.
    """

    def __init__(
        self,
        site: SiteOnMap,
        receiver: Receiver,
        every_s: float = 1.0,
        pace: float = 1.0,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """`pace` is the number of seconds of the session in one second of the map."""
        self._site, self._receiver, self._now = site, receiver, now
        self._picture = PictureOnMap(site, pace)
        self._every = timedelta(seconds=min(every_s, site.world.stale_s / 2))
        self._last: datetime | None = None
        self._drawn: tuple[int, datetime] | None = None

    def take(self, event: Event) -> None:
        """Take one event of the session; only pictures and the end are shown."""
        match event.data:
            case TelemetryReceived(picture=picture):
                moment = min(event.t, self._now())
                # A negative difference means that the clock was set back: the picture is shown.
                if self._last is not None and timedelta() <= moment - self._last < self._every:
                    return
                self._last = moment
                self._receiver.send([*self._ground(moment), *self._picture.events(picture, moment)])
            case SessionEnded():
                self.end()
            case _:
                pass

    def end(self) -> None:
        """Remove tracks, routes and the ground from the map; assets go stale by themselves."""
        now = self._now()
        drawn = self._site.ground_deleted(now) if self._drawn is not None else []
        self._drawn = None
        self._receiver.send([*self._picture.deleted(now), *drawn])

    def _ground(self, now: datetime) -> list[CotEvent]:
        """Return the ground: after each connection, and again before it goes stale."""
        connections = self._receiver.connections
        if self._drawn is not None:
            before, at = self._drawn
            if before == connections and now - at < timedelta(seconds=DRAWN_S / 2):
                return []
        self._drawn = connections, now
        return self._site.ground(now, now + timedelta(seconds=DRAWN_S))


DRAWING_S = 3.0
"""The longest wait at the end for a picture that is being drawn."""


class InBackground:
    """A thread that gives `show` the pictures and the end of a session in its `with` block.

    Of several waiting pictures only the newest is shown, so that the session never waits. An error
    of `show` ends the thread; `tell` gets it in one line.
    """

    def __init__(self, show: Callable[[Event], object], tell: Callable[[str], object]) -> None:
        self._show, self._tell = show, tell
        self._picture: Event | None = None
        self._end: Event | None = None
        self._over = False
        self._news = Condition()
        self._thread = Thread(target=self._run, name="tak pictures", daemon=True)

    def take(self, event: Event) -> None:
        """Take one event of the session; return at once."""
        match event.data:
            case TelemetryReceived():
                with self._news:
                    self._picture = event
                    self._news.notify()
            case SessionEnded():
                with self._news:
                    self._end = event
                    self._news.notify()
            case _:
                pass

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        with self._news:
            self._over = True
            self._news.notify()
        self._thread.join(DRAWING_S)

    def _run(self) -> None:
        try:
            while waiting := self._next():
                for event in waiting:
                    self._show(event)
        except Exception as error:  # an error on the map must not end the session
            self._tell(f"nothing more is shown: {type(error).__name__}: {error}")

    def _next(self) -> list[Event]:
        """Wait for events to show and return them; none at the end."""
        with self._news:
            self._news.wait_for(lambda: self._picture or self._end or self._over)
            waiting = [event for event in (self._picture, self._end) if event is not None]
            self._picture = self._end = None
        return waiting
