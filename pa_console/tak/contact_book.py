"""The contacts that other senders report: few, for a limited time, with their changes."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta

from pa_console.schema.base import Point
from pa_console.schema.events.session import (
    MOST_CONTACTS,
    ContactLost,
    ContactReported,
    LossReason,
    ReportedContact,
)
from pa_console.tak.cot_event import ReceivedEvent

REPORTED_EVERY = timedelta(seconds=5)
"""The least time between two reports of the same contact."""
HOLDS_MOST = timedelta(minutes=10)
"""The longest validity of a report, even if its sender claims a longer one."""
MOVED_M = 0.5
"""The least distance that counts as a movement."""
NEWCOMER_EVERY = timedelta(seconds=10)
"""The time between new contacts once the most have come: no sender can fill the log."""


@dataclass
class _Known:
    contact: ReportedContact
    reported: ReportedContact | None = None
    reported_at: datetime | None = None

    def is_news(self, now: datetime) -> bool:
        """Return True if the contact is new, or has changed since its last report in time."""
        if self.reported is None or self.reported_at is None:
            return True
        # A negative difference means that the clock was set back: waiting could take for ever.
        if timedelta() <= now - self.reported_at < REPORTED_EVERY:
            return False
        before, here = self.reported, self.contact
        claims = ("callsign", "affiliation", "what", "error_m")
        changed = any(getattr(before, name) != getattr(here, name) for name in claims)
        return changed or math.dist(before.at, here.at) > MOVED_M


class ContactBook:
    """The contacts by uid. The caller gives the time; its clock may be set back."""

    def __init__(self) -> None:
        self._known: dict[str, _Known] = {}
        self._lost: list[ContactLost] = []
        self._places = float(MOST_CONTACTS)
        self._counted: datetime | None = None

    def take(self, heard: ReceivedEvent, at: Point, now: datetime) -> bool:
        """Add a report of a thing `at` a point; return False if there is no room for it."""
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
        if (known := self._known.get(heard.uid)) is not None:
            known.contact = contact
            return True
        if not self._has_place(now):
            return False
        self._known[heard.uid] = _Known(contact)
        return True

    def lose(self, uid: str, reason: LossReason) -> None:
        """Remove a contact; its loss is reported only if the contact was."""
        known = self._known.pop(uid, None)
        if known is not None and known.reported is not None:
            self._lost.append(ContactLost(uid=uid, reason=reason))

    def news(self, now: datetime) -> Iterator[ContactReported | ContactLost]:
        """Yield the reports of lost contacts, then of new and changed ones."""
        most = now + HOLDS_MOST  # the bound also holds after the clock was set back
        stales = {uid: known.contact.stale for uid, known in self._known.items()}
        for uid in (uid for uid, stale in stales.items() if not now < stale <= most):
            self.lose(uid, "stale")
        lost, self._lost = self._lost, []
        yield from lost
        for known in self._known.values():
            if known.is_news(now):
                known.reported, known.reported_at = known.contact, now
                yield ContactReported(contact=known.contact)

    def _has_place(self, now: datetime) -> bool:
        passed = max(now - self._counted, timedelta()) if self._counted else timedelta()
        self._counted = now
        self._places = min(self._places + passed / NEWCOMER_EVERY, float(MOST_CONTACTS))
        if len(self._known) >= MOST_CONTACTS or self._places < 1.0:
            return False
        self._places -= 1.0
        return True
