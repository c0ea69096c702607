"""What is to be told in a session of a TAK server: the connection, contacts, and impostors.

The connection's thread brings it in, the session takes it out; neither waits for the other.
"""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from itertools import chain
from threading import Lock

from pa_console.schema.base import Point
from pa_console.schema.events.tak import ContactsLeftOut, Noticed, OutsideReport, TakChanged
from pa_console.schema.world import World
from pa_console.tak.cot_event import DELETE, CotEvent
from pa_console.tak.inbound.contact_book import ContactBook
from pa_console.tak.inbound.event_stream import EventStream
from pa_console.tak.inbound.heard_event import HeardEvent, read_event
from pa_console.tak.inbound.own_events import OwnEvents
from pa_console.tak.site_on_map import SiteOnMap

MARGIN_M = 100.0
"""A contact so far beyond the farthest point of the world is still shown."""
READ_A_SECOND = 200
"""So many events are read in a second; those beyond it are counted and thrown away."""
MOST_NAMES = 1000
"""Of things left out so many are told from each other; the count ends there."""
MOST_IMPOSTORS = 8
"""Somebody who speaks as more of ours is told of once more, without names."""
LEFT_OUT_EVERY = timedelta(minutes=1)


class TakReports:
    """Takes in what comes over the connection; `news` is what of it is to be told.

    Without `contacts` nothing that the server sends is read.
    """

    def __init__(
        self,
        site: SiteOnMap,
        server: str,
        *,
        contacts: bool = True,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """`server` is its address, `now` this machine's clock."""
        self._site, self._server, self._contacts, self._now = site, server, contacts, now
        self._lock = Lock()
        self._own, self._book = OwnEvents(site, now), ContactBook()
        self._stream = EventStream()
        self._bounds = _bounds(site.world)
        self._second, self._read = now(), 0
        self._outside, self._crowded = set[str](), set[str]()
        self._unread = self._unreadable = 0
        self._impostors: dict[str, None] = {}
        self._notices: list[Noticed] = []
        self._changed: TakChanged | None = None
        self._left_out, self._left_out_at = ContactsLeftOut(), now() - LEFT_OUT_EVERY

    def connected(self, line: str) -> None:
        """Note that there is a connection; what came half over the last one is forgotten."""
        with self._lock:
            self._unreadable += self._stream.broken
            self._stream = EventStream()
            self._changed = TakChanged(server=self._server, state="connected", detail=line)

    def away(self, line: str) -> None:
        """Note that there is no connection, and why."""
        with self._lock:
            self._changed = TakChanged(server=self._server, state="away", detail=line)

    def sent(self, event: CotEvent) -> None:
        """Note what this console is about to send."""
        if self._contacts:
            with self._lock:
                self._own.sent(event)

    def heard(self, data: bytes) -> None:
        """Take in what the server has sent."""
        if not self._contacts:
            return
        for document in self._stream.feed(data):
            now = self._now()
            if not timedelta() <= now - self._second < timedelta(seconds=1):
                self._second, self._read = now, 0
            self._read += 1
            is_read = self._read <= READ_A_SECOND
            heard = read_event(document) if is_read else None
            with self._lock:
                self._unread += not is_read
                self._unreadable += is_read and heard is None
                if heard is not None:
                    self._take(heard, now)

    def news(self) -> list[OutsideReport]:
        """Return what is to be told since this was last asked."""
        with self._lock:
            now = self._now()
            changed = [] if self._changed is None else [self._changed]
            notices, self._changed, self._notices = self._notices, None, []
            return list(chain(changed, notices, self._book.news(now), self._not_shown(now)))

    def _take(self, heard: HeardEvent, now: datetime) -> None:
        if name := self._own.impostor(heard):
            self._tell_of_impostor(name)
        if self._own.holds(heard.subject):
            return
        if heard.type == DELETE:
            self._book.lose(heard.subject, "removed")
        elif heard.places:
            at = self._place(heard)
            if at is None:
                self._book.lose(heard.uid, "left")
                _count(self._outside, heard.uid)
            elif not self._book.take(heard, at, now):
                _count(self._crowded, heard.uid)

    def _place(self, heard: HeardEvent) -> Point | None:
        """Return where on the site something is, None for what is beyond."""
        at = self._site.geography.near(heard.latitude, heard.longitude)
        (west, south), (east, north) = self._bounds
        return at if at and west <= at[0] <= east and south <= at[1] <= north else None

    def _tell_of_impostor(self, name: str) -> None:
        if name in self._impostors or len(self._impostors) > MOST_IMPOSTORS:
            return
        self._impostors[name] = None
        more = len(self._impostors) > MOST_IMPOSTORS
        text = f"somebody on the TAK server speaks as {'others of ours too' if more else name}"
        self._notices.append(Noticed(level="alarm", subject="TAK", text=text))

    def _not_shown(self, now: datetime) -> list[ContactsLeftOut]:
        """Return how much is left out, when that is news and the last time was long ago."""
        left_out = ContactsLeftOut(
            outside=len(self._outside),
            too_many=len(self._crowded) + self._unread,
            unreadable=self._unreadable + self._stream.broken,
        )
        waited = now - self._left_out_at
        if left_out == self._left_out or timedelta() <= waited < LEFT_OUT_EVERY:
            return []
        self._left_out, self._left_out_at = left_out, now
        return [left_out]


def _count(names: set[str], name: str) -> None:
    if len(names) < MOST_NAMES:
        names.add(name)


def _bounds(world: World) -> tuple[Point, Point]:
    """Return the south-west and the north-east corner of what is near enough, in metres."""
    points = [
        *world.perimeter,
        *(frame.at for frame in world.frames.values()),
        *(camera.at for camera in world.cameras.values()),
        *(point for wall in world.walls for point in (wall.start, wall.end)),
        *(point for zone in world.zones.values() for point in zone.polygon),
        *(point for lane in world.lanes.values() for point in lane.points),
    ]
    east, north = ([at[axis] for at in points] for axis in (0, 1))
    return (
        (min(east) - MARGIN_M, min(north) - MARGIN_M),
        (max(east) + MARGIN_M, max(north) + MARGIN_M),
    )
