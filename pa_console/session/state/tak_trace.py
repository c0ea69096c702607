"""What a TAK server has told a session, and how each event adds to that.

It stands beside the picture and never in it: nothing that plans, checks or alarms reads it.
"""

from dataclasses import dataclass, field
from datetime import datetime

from pa_console.schema.events import event as ev
from pa_console.session.wording import contact_in_words

LEFT_OUT = {
    "outside": "contacts beyond the site are reported; they are not shown",
    "too_many": f"more is reported than is shown: {ev.MOST_CONTACTS} contacts at a time",
    "unreadable": "the server sends what is no event; it is left out",
}
"""What is told once of contacts that are not shown, by the reason."""

GONE = {
    "stale": "not heard any more",
    "removed": "removed by its sender",
    "left": "beyond the site",
}
Line = tuple[ev.Level, str]
"""A line of the event list."""


@dataclass
class TakTrace:
    """The connection to the TAK server `since` it is as it is, and the contacts by their uids."""

    connection: ev.TakChanged | None = None
    since: datetime | None = None
    contacts: dict[str, ev.ReportedContact] = field(default_factory=dict[str, ev.ReportedContact])
    left_out: ev.ContactsLeftOut = field(default_factory=ev.ContactsLeftOut)

    @property
    def away(self) -> bool:
        """Whether there is a server, and no connection to it."""
        return self.connection is not None and self.connection.state == "away"

    def apply(self, event: ev.Event) -> list[Line]:
        """Take one event in; return what is to be said of it."""
        match event.data:
            case ev.TakChanged():
                return self._connection_changed(event.data, event.t)
            case ev.ContactReported(contact=contact):
                return self._reported(contact)
            case ev.ContactLost(uid=uid, reason=reason) if uid in self.contacts:
                lost = contact_in_words(self.contacts.pop(uid))
                return [("info", f"no longer reported, {GONE[reason]}: {lost}")]
            case ev.ContactsLeftOut():
                before, self.left_out = self.left_out, event.data
                first = (name for name in LEFT_OUT if not getattr(before, name))
                return [("info", LEFT_OUT[name]) for name in first if getattr(event.data, name)]
            case ev.SessionResumed():
                self.connection, self.since, self.contacts = None, None, {}
                return []
            case _:
                return []

    def _connection_changed(self, now: ev.TakChanged, t: datetime) -> list[Line]:
        before, self.connection = self.connection, now
        if before is not None and (before.state, before.server) == (now.state, now.server):
            return []
        self.since = t
        return [("info" if now.state == "connected" else "warning", now.detail)]

    def _reported(self, contact: ev.ReportedContact) -> list[Line]:
        known = contact.uid in self.contacts
        if not known and len(self.contacts) >= ev.MOST_CONTACTS:
            return []
        self.contacts[contact.uid] = contact
        said = f"reported, not seen by our sensors: {contact_in_words(contact)}"
        return [] if known else [("info", said)]
