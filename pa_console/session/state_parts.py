"""Parts of a session's state: notices, alarms, a stop, orders, manual control, TAK contacts."""

from dataclasses import dataclass, field
from datetime import datetime

from pa_console.schema.events import event as ev
from pa_console.schema.mission import Alarm, StandingOrder
from pa_console.session.mission_trace import CommandTrace
from pa_console.session.wording import contact_in_words

LEFT_OUT = {
    "outside": "contacts beyond the site are reported but not shown",
    "too_many": f"more contacts are reported than are shown: {ev.MOST_CONTACTS} at a time",
    "unreadable": "the server sends malformed events, which are left out",
}
"""The notice about contacts that are not shown, by reason. Each notice is given once."""

GONE = {
    "stale": "report expired",
    "removed": "removed by its sender",
    "left": "beyond the site",
}


@dataclass(frozen=True)
class Notice:
    """One line of the event list; if it is `hidden`, the operator could not know it at the time."""

    t: datetime
    tick: int
    level: ev.Level
    subject: str
    text: str
    hidden: bool = False


@dataclass(frozen=True)
class OpenAlarm:
    """An alarm whose cause persists; `acknowledged_by` is '' until an operator has seen it."""

    alarm: Alarm
    acknowledged_by: str = ""

    @property
    def acknowledged(self) -> bool:
        """True once an operator has seen the alarm."""
        return bool(self.acknowledged_by)


@dataclass
class Stop:
    """The operator's stop until its release, and the latest command to each asset since then."""

    by: str
    tick: int
    orders: dict[str, CommandTrace] = field(default_factory=dict[str, CommandTrace])
    overdue: dict[str, str] = field(default_factory=dict[str, str])
    """The assets that should hold by now but are not known to hold, each with the reason."""

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """The assets that have not reported that they hold, or are not seen to hold."""
        return tuple(
            name for name, sent in self.orders.items() if name in self.overdue or not _is_done(sent)
        )

    @property
    def held(self) -> int:
        """The number of assets that have reported, and are seen, to hold."""
        return len(self.orders) - len(self.unconfirmed)


@dataclass(frozen=True)
class StartTrace:
    """One mission that a standing order has started, at a `tick` of the simulation."""

    tick: int
    subject: str
    mission: str


@dataclass
class StandingTrace:
    """One approved standing order and its starts; `ended` is the reason why it is over."""

    order: StandingOrder
    by: str
    since_tick: int
    starts: list[StartTrace] = field(default_factory=list[StartTrace])
    started: int = 0
    """The number of missions started; `starts` has only the latest of them."""
    withheld: ev.StandingOrderWithheld | None = None
    """The event of the last time that the order did not start a mission."""
    next: ev.StandingOrderScheduled | None = None
    """The order's next moment, and whether the order is paused."""
    ended: str = ""

    @property
    def in_force(self) -> bool:
        """True until the order is revoked or over."""
        return not self.ended

    @property
    def paused(self) -> bool:
        """True while the order is paused and starts no mission."""
        return self.next is not None and self.next.paused

    @property
    def last(self) -> StartTrace | None:
        """The last mission that the order started."""
        return self.starts[-1] if self.starts else None


@dataclass(frozen=True)
class ManualTrace:
    """The start of manual control of an asset: the operator and the tick."""

    by: str
    tick: int


@dataclass
class TakTrace:
    """The connection to a TAK server, last changed at `since`, and the contacts by uid.

    This is separate from the picture: planning, checks and alarms do not read it.
    """

    connection: ev.TakChanged | None = None
    since: datetime | None = None
    contacts: dict[str, ev.ReportedContact] = field(default_factory=dict[str, ev.ReportedContact])
    left_out: ev.ContactsLeftOut = field(default_factory=ev.ContactsLeftOut)

    @property
    def away(self) -> bool:
        """True if a server is configured but not connected."""
        return self.connection is not None and self.connection.state == "away"

    def apply(self, event: ev.Event) -> list[tuple[ev.Level, str]]:
        """Apply one event; return the levels and texts of its lines in the event list."""
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

    def _connection_changed(self, now: ev.TakChanged, t: datetime) -> list[tuple[ev.Level, str]]:
        before, self.connection = self.connection, now
        if before is not None and (before.state, before.server) == (now.state, now.server):
            return []
        self.since = t
        return [("info" if now.state == "connected" else "warning", now.detail)]

    def _reported(self, contact: ev.ReportedContact) -> list[tuple[ev.Level, str]]:
        is_known = contact.uid in self.contacts
        if not is_known and len(self.contacts) >= ev.MOST_CONTACTS:
            return []
        self.contacts[contact.uid] = contact
        text = f"reported, not seen by our sensors: {contact_in_words(contact)}"
        return [] if is_known else [("info", text)]


def _is_done(sent: CommandTrace) -> bool:
    return bool(sent.replies) and sent.replies[-1].status == "done"
