"""Keeps the contacts that others report, few and for a while, and says what is new of them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta

from pa_console.schema.base import Point
from pa_console.schema.events.tak import (
    MOST_CONTACTS,
    ContactLost,
    ContactReported,
    LossReason,
    ReportedContact,
)
from pa_console.tak.inbound.heard_event import HeardEvent

TOLD_EVERY = timedelta(seconds=5)
"""What has changed of one contact is told at most so often."""
HOLDS_MOST = timedelta(minutes=10)
"""A report holds for so long at most, whatever its sender claims."""
MOVED_M = 0.5
"""Whatever has moved less is where it was."""
NEWCOMER_EVERY = timedelta(seconds=10)
"""Once so many are new as are kept, one more may come so often: no sender fills the log."""


@dataclass
class _Known:
    contact: ReportedContact
    told: ReportedContact | None = None
    told_at: datetime | None = None

    def is_news(self, now: datetime) -> bool:
        """Whether it is to be told: at once when it is new, else in its time."""
        if self.told is None or self.told_at is None:
            return True
        if timedelta() <= now - self.told_at < TOLD_EVERY:
            return False
        before, here = self.told, self.contact
        claims = ("callsign", "affiliation", "what", "error_m")
        changed = any(getattr(before, name) != getattr(here, name) for name in claims)
        return changed or math.dist(before.at, here.at) > MOVED_M


class ContactBook:
    """The contacts by uid. Moments are given by the caller, whose clock may be set back."""

    def __init__(self) -> None:
        self._known: dict[str, _Known] = {}
        self._lost: list[ContactLost] = []
        self._places = float(MOST_CONTACTS)
        self._counted: datetime | None = None

    def take(self, heard: HeardEvent, at: Point, now: datetime) -> bool:
        """Note that something was reported `at` a point; returns whether it is kept."""
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
        """Note that a contact is gone; of one that was never told nothing is to be said."""
        known = self._known.pop(uid, None)
        if known is not None and known.told is not None:
            self._lost.append(ContactLost(uid=uid, reason=reason))

    def news(self, now: datetime) -> Iterator[ContactReported | ContactLost]:
        """Yield what is to be told now: what is gone, then what is new or has changed."""
        most = now + HOLDS_MOST  # where the clock was set back, nothing holds for longer either
        stales = {uid: known.contact.stale for uid, known in self._known.items()}
        for uid in (uid for uid, stale in stales.items() if not now < stale <= most):
            self.lose(uid, "stale")
        lost, self._lost = self._lost, []
        yield from lost
        for known in self._known.values():
            if known.is_news(now):
                known.told, known.told_at = known.contact, now
                yield ContactReported(contact=known.contact)

    def _has_place(self, now: datetime) -> bool:
        passed = max(now - self._counted, timedelta()) if self._counted else timedelta()
        self._counted = now
        self._places = min(self._places + passed / NEWCOMER_EVERY, float(MOST_CONTACTS))
        if len(self._known) >= MOST_CONTACTS or self._places < 1.0:
            return False
        self._places -= 1.0
        return True
