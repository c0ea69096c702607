"""Reports from a TAK server for a session: its connection, unverified contacts, and impostors.

Everything from a server is bounded in size, rate, number and validity.
"""

import math
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from itertools import chain
from threading import Lock

from pa_console.schema.base import Point
from pa_console.schema.events.session import (
    MOST_CALLSIGN,
    MOST_CONTACTS,
    ContactLost,
    ContactReported,
    ContactsLeftOut,
    LossReason,
    Noticed,
    OutsideReport,
    ReportedContact,
    TakChanged,
    TakState,
)
from pa_console.schema.world import World
from pa_console.tak.cot_event import DELETE, CotEvent, EventStream, ReceivedEvent, read_event
from pa_console.tak.session_on_map import SiteOnMap

REPORTED_EVERY = timedelta(seconds=5)
"""The shortest time between two reports of the same contact."""
HOLDS_MOST = timedelta(minutes=10)
"""The longest validity of a report, even if its sender claims a longer one."""
MOVED_M = 0.5
"""The shortest distance that counts as a movement, in metres."""
NEWCOMER_EVERY = timedelta(seconds=10)
"""The time between new contacts after the first MOST_CONTACTS, so that no sender can fill the
log."""
MARGIN_M = 100.0
"""The distance beyond the farthest point of the world up to which contacts are shown, in metres."""
READ_A_SECOND = 200
"""The most events that are read in a second; the others are counted and dropped."""
MOST_NAMES = 1000
"""The most omitted things that are counted."""
MOST_IMPOSTORS = 8
"""The most impostors that are named; one more notice stands for the others."""
SENT_KEPT = 30
"""The number of sent events kept for each thing, because a server may return the last ones."""
MOST_THINGS = 10_000
ROUNDED = 2e-6
"""The tolerance of angles, which a server may round, in degrees."""
LEFT_OUT_EVERY = timedelta(minutes=1)
SAME = timedelta(milliseconds=20)
"""The tolerance of times, which a server may round."""


@dataclass
class _KnownContact:
    contact: ReportedContact
    reported: ReportedContact | None = None
    reported_at: datetime | None = None

    def is_news(self, now: datetime) -> bool:
        """Return True if the contact is new, or has changed and its last report is old enough."""
        if self.reported is None or self.reported_at is None:
            return True
        # If the clock was set back, the difference is negative, and the wait could last forever.
        if timedelta() <= now - self.reported_at < REPORTED_EVERY:
            return False
        before, here = self.reported, self.contact
        claims = ("callsign", "affiliation", "what", "error_m")
        changed = any(getattr(before, name) != getattr(here, name) for name in claims)
        return changed or math.dist(before.at, here.at) > MOVED_M


class ContactBook:
    """The contacts by uid; the caller passes the time, and its clock may be set back."""

    def __init__(self) -> None:
        self._known: dict[str, _KnownContact] = {}
        self._lost: list[ContactLost] = []
        self._places = float(MOST_CONTACTS)
        self._counted: datetime | None = None

    def take(self, heard: ReceivedEvent, at: Point, now: datetime) -> bool:
        """Add a report of a thing at the point `at`; return False if there is no room for it."""
        stale = min(heard.stale, now + HOLDS_MOST)
        if stale <= now:
            self.lose(heard.uid, "stale")
            return True
        contact = ReportedContact(
            uid=heard.uid,
            callsign=heard.callsign,
            affiliation=heard.affiliation,
            what=heard.what,
            at=(round(at[0], 2), round(at[1], 2)),
            error_m=heard.ce,
            time=min(heard.time, now),
            stale=stale,
        )
        if (old := self._known.get(heard.uid)) is not None:
            old.contact = contact
            return True
        if not self._has_place(now):
            return False
        self._known[heard.uid] = _KnownContact(contact)
        return True

    def lose(self, uid: str, reason: LossReason) -> None:
        """Remove a contact; its loss is reported only if the contact was reported."""
        contact = self._known.pop(uid, None)
        if contact is not None and contact.reported is not None:
            self._lost.append(ContactLost(uid=uid, reason=reason))

    def news(self, now: datetime) -> Iterator[ContactReported | ContactLost]:
        """Yield the reports of lost contacts, then of new and changed ones."""
        most = now + HOLDS_MOST  # the bound also holds if the clock was set back
        stales = {uid: contact.contact.stale for uid, contact in self._known.items()}
        for uid in (uid for uid, stale in stales.items() if not now < stale <= most):
            self.lose(uid, "stale")
        lost, self._lost = self._lost, []
        yield from lost
        for contact in self._known.values():
            if contact.is_news(now):
                contact.reported, contact.reported_at = contact.contact, now
                yield ContactReported(contact=contact.contact)

    def _has_place(self, now: datetime) -> bool:
        passed = max(now - self._counted, timedelta()) if self._counted else timedelta()
        self._counted = now
        self._places = min(self._places + passed / NEWCOMER_EVERY, float(MOST_CONTACTS))
        if len(self._known) >= MOST_CONTACTS or self._places < 1.0:
            return False
        self._places -= 1.0
        return True


@dataclass(frozen=True)
class _OwnEvent:
    type: str
    time: datetime
    stale: datetime
    latitude: float
    longitude: float
    callsign: str


class OwnEvents:
    """The events that this console has sent, used to detect other senders with the site's uids."""

    def __init__(
        self, site: SiteOnMap, now: Callable[[], datetime] = lambda: datetime.now(UTC)
    ) -> None:
        # Events from before this moment may come from an earlier session of the site.
        self._prefix = site.uid("")
        self._prefixes = self._prefix, replace(site, replay=True).uid("")
        self._begun, self._lasts = now(), timedelta(seconds=site.world.stale_s)
        self._sent: OrderedDict[str, deque[_OwnEvent]] = OrderedDict()

    def sent(self, event: CotEvent) -> None:
        """Record `event`, which is about to be sent."""
        if not (event.type.startswith("a-") or event.type == DELETE):
            return
        subject, at = event.subject, event.point
        callsign = next((e.get("callsign", "") for e in event.detail if e.tag == "contact"), "")
        sent = self._sent.pop(subject, None)
        self._sent[subject] = sent if sent is not None else deque[_OwnEvent](maxlen=SENT_KEPT)
        self._sent[subject].append(
            _OwnEvent(
                event.type,
                event.time,
                event.stale,
                at.latitude,
                at.longitude,
                callsign[:MOST_CALLSIGN],
            )
        )
        if len(self._sent) > MOST_THINGS:
            self._sent.popitem(last=False)

    def holds(self, uid: str) -> bool:
        """Return True if `uid` belongs to this site, live or in a replay."""
        return uid.startswith(self._prefixes)

    def impostor(self, heard: ReceivedEvent) -> str:
        """Return the name of the site's thing that another sender claims to be; '' if none.

        Only events that report a position or remove a thing count; drawings do not.
        """
        relevant = heard.has_place or heard.type == DELETE
        if not relevant or not heard.subject.startswith(self._prefix):
            return ""
        if any(_is_same(sent, heard) for sent in self._sent.get(heard.subject, ())):
            return ""
        if heard.time < self._begun and heard.stale - heard.time <= self._lasts + SAME:
            return ""
        return heard.subject.removeprefix(self._prefix)


def _is_same(sent: _OwnEvent, heard: ReceivedEvent) -> bool:
    """Return True if `heard` is `sent` as returned by a server, perhaps with a shorter validity."""
    return (
        sent.type == heard.type
        and abs(sent.time - heard.time) <= SAME
        and heard.stale <= sent.stale + SAME
        and abs(sent.latitude - heard.latitude) <= ROUNDED
        and abs(sent.longitude - heard.longitude) <= ROUNDED
        and sent.callsign == heard.callsign
    )


class TakReports:
    """The reports of one connection; `news` returns the new ones.

    The connection's thread adds reports and the session takes them; neither waits for the other.
    Without `contacts`, nothing that the server sends is read.
    """

    def __init__(
        self,
        site: SiteOnMap,
        server: str,
        *,
        contacts: bool = True,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """Collect reports about `server`, its address; `now` returns this machine's time."""
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

    def connection_changed(self, state: TakState, line: str) -> None:
        """Report the new state of the connection, which `line` describes in words."""
        with self._lock:
            if state == "connected":  # the rest of a cut-off event never arrives
                self._unreadable += self._stream.broken
                self._stream = EventStream()
            self._changed = TakChanged(server=self._server, state=state, detail=line)

    def sent(self, event: CotEvent) -> None:
        """Record an event that this console is about to send."""
        if self._contacts:
            with self._lock:
                self._own.sent(event)

    def received(self, data: bytes) -> None:
        """Process bytes from the server, in pieces of any length."""
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
        """Return the reports since the last call."""
        with self._lock:
            now = self._now()
            changed = [] if self._changed is None else [self._changed]
            notices, self._changed, self._notices = self._notices, None, []
            return list(chain(changed, notices, self._book.news(now), self._not_shown(now)))

    def _take(self, heard: ReceivedEvent, now: datetime) -> None:
        if name := self._own.impostor(heard):
            self._report_impostor(name)
        if self._own.holds(heard.subject):
            return
        if heard.type == DELETE:
            self._book.lose(heard.subject, "removed")
        elif heard.has_place:
            at = self._place(heard)
            if at is None:
                self._book.lose(heard.uid, "left")
                _count(self._outside, heard.uid)
            elif not self._book.take(heard, at, now):
                _count(self._crowded, heard.uid)

    def _place(self, heard: ReceivedEvent) -> Point | None:
        """Return the position of a thing on the site, or None beyond its bounds."""
        at = self._site.geography.near(heard.latitude, heard.longitude)
        (west, south), (east, north) = self._bounds
        return at if at and west <= at[0] <= east and south <= at[1] <= north else None

    def _report_impostor(self, name: str) -> None:
        if name in self._impostors or len(self._impostors) > MOST_IMPOSTORS:
            return
        self._impostors[name] = None
        more = len(self._impostors) > MOST_IMPOSTORS
        claimed = "other things of this site too" if more else name
        text = f"another sender on the TAK server claims to be {claimed}"
        self._notices.append(Noticed(level="alarm", subject="TAK", text=text))

    def _not_shown(self, now: datetime) -> list[ContactsLeftOut]:
        """Return the numbers of omitted things, if they have changed and a new report is due."""
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
    """Return the south-west and north-east corners of the shown area, in metres."""
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
