"""The session log that a station shares on a bus; missing records are requested again."""

import time
from collections.abc import Callable
from datetime import UTC, datetime
from time import monotonic
from typing import Any

from pa_console.fleets.authorization import RefusedError, SignedMessages, Trust
from pa_console.fleets.vda5050.additions import (
    MANUFACTURER,
    SIGNED,
    TRUST,
    RecordsAsked,
    SessionRecords,
    SignedMessage,
)
from pa_console.fleets.vda5050.broker import OutgoingMessage
from pa_console.fleets.vda5050.station_link import Delivery, StationLink
from pa_console.fleets.vda5050.wire import Header, Identity, Numbers, Topic, UnreadableError
from pa_console.schema.events.event import Event
from pa_console.session.log.chain import LogRecord, link_problem, parse

LOOK_S = 0.1
ASK_AGAIN_S = 1.0
FOUND_S = 10.0
"""The longest wait for records of a session when joining, in seconds."""


class NotBelievedError(ValueError):
    """The error for records that belong to another session, or have no valid signature."""


class RecordStream:
    """The records of one session, received in order and without gaps.

    The stream follows the first session for which the station in command signs records. Each
    message is signed by that station, and each record contains the hash of the previous record.
    """

    def __init__(self, trust: Trust, now: Callable[[], float]) -> None:
        """Verify records with the site's `trust`; `now` returns seconds since 1970."""
        self._trust, self._now = trust, now
        self.station, self.session = "", ""
        """The station's name in the roster, and the id of its session; '' before any records."""
        self._last: LogRecord | None = None
        self.seen = 0
        """The number of the last record announced by the station."""

    @property
    def wanted(self) -> int:
        """The number of the next record to receive."""
        return int(self._last.fields["seq"]) + 1 if self._last is not None else 1

    @property
    def head(self) -> str:
        """The hash of the last record received; '' if no record has been received."""
        return self._last.hash if self._last is not None else ""

    @property
    def missing(self) -> int:
        """The number of announced records that have not been received."""
        return max(self.seen - self.wanted + 1, 0)

    def take(self, station: str, message: SessionRecords) -> list[Event]:
        """Return the events of the next records; an empty list if an earlier record is missing.

        If the records are not from this session's log, none of them is accepted, and
        NotBelievedError is raised.
        """
        try:
            vouched = self._trust.records(station, message.signature, self._now())
        except RefusedError as refused:
            raise NotBelievedError(str(refused)) from refused
        claim = message.session, message.first, message.last
        if (vouched.session, vouched.first, vouched.last) != claim:
            raise NotBelievedError(f"the signature of {station} is for other records")
        if not self.session:
            self._follow(station, vouched.session)
        if station != self.station:
            raise NotBelievedError(f"{station} also shares a session")
        if vouched.session != self.session:
            raise NotBelievedError(f"{station} shares another session now; join again to see it")
        self.seen = max(self.seen, vouched.last)
        if not vouched.first <= self.wanted <= vouched.last:
            return []
        return self._chained(message, vouched.head)

    def _follow(self, station: str, session: str) -> None:
        roster, takeover = self._trust.roster, self._trust.takeover
        if takeover.epoch and roster.station_of(takeover.station) != station:
            raise NotBelievedError(f"{station} shares a session, but {self._trust.in_command}")
        self.station, self.session = station, session

    def _chained(self, message: SessionRecords, head: str) -> list[Event]:
        """Return the events of a message; its hashes must lead from the last record to `head`."""
        last, events = self._last, list[Event]()
        try:
            lines = message.lines()
            if len(lines) != message.last - message.first + 1:
                raise NotBelievedError("a message does not have the stated number of records")
            for line in lines[self.wanted - message.first :]:
                record = parse(line)
                problem = link_problem(record, last)
                if problem or record.fields["session"] != self.session:
                    raise NotBelievedError(problem or "a record belongs to another session")
                last = record
                events.append(record.event)
        except NotBelievedError:
            raise
        except UnreadableError as error:
            raise NotBelievedError(str(error)) from error
        except ValueError as error:
            raise NotBelievedError(f"a record cannot be read: {error}") from error
        if last is None or last.hash != head:
            raise NotBelievedError("the last record of a message is not the signed one")
        self._last = last
        return events


HEARD = (SessionRecords, *SIGNED)


class SharedLog:
    """The received part of a session's log; `problem` is why a message was last rejected."""

    def __init__(self, link: StationLink, trust: Trust, keep: Callable[[str], object]) -> None:
        """Pass every accepted roster, revocation and takeover that is newer to `keep`."""
        self.link, self.trust, self._keep = link, trust, keep
        self.stream = RecordStream(trust, time.time)
        self.problem = ""
        self._signed, self._numbers = SignedMessages(trust.take), Numbers()
        self._wanted, self._asked_at = 0, 0.0

    def take(self) -> list[Event]:
        """Return the events of the session since the last call, in order."""
        events: list[Event] = []
        for delivery in self.link.take():
            events += self._events_of(delivery)
        self._ask()
        return events

    def publish(self, message: Header, expiry_s: int | None = None) -> bool:
        """Send `message` to the station; return False if there is no connection."""
        topic = Topic(self.link.address.site, self._identity, message.TOPIC)
        return self.link.publish(
            OutgoingMessage(str(topic), message.write(), qos=1, expiry_s=expiry_s)
        )

    def header(self, kind: type[Header]) -> dict[str, Any]:
        """Return the header for the next message of this kind to the station."""
        return self._numbers.header(self._identity, kind.TOPIC, datetime.now(UTC))

    @property
    def _identity(self) -> Identity:
        return Identity(MANUFACTURER, self.stream.station)

    def _events_of(self, delivery: Delivery) -> list[Event]:
        identity = delivery.topic.identity
        match delivery.message:
            case UnreadableError() as error:
                self.problem = f"{identity.serial_number}: {error}"
            case SignedMessage() as signed if identity == TRUST:
                if not self._signed.hear(signed.message):
                    self._keep(signed.message)
            case SessionRecords() as records if identity.manufacturer == MANUFACTURER:
                try:
                    return self.stream.take(identity.serial_number, records)
                except NotBelievedError as error:
                    self.problem = str(error)
            case _:
                pass
        return []

    def _ask(self) -> None:
        """Request the missing records, and request them again if they do not arrive."""
        wanted, now = self.stream.wanted, monotonic()
        if self.stream.missing and (wanted != self._wanted or now - self._asked_at > ASK_AGAIN_S):
            self._wanted, self._asked_at = wanted, now
            header = self.header(RecordsAsked)
            self.publish(RecordsAsked(**header, session=self.stream.session, first=wanted))


def read_so_far(log: SharedLog, progress: Callable[[int, int], object]) -> list[Event]:
    """Wait for the shared session, and return its events so far.

    `progress` is called with the number of records received and the number of all records. Raises
    ValueError if no records arrive for FOUND_S seconds.
    """
    events: list[Event] = []
    until = monotonic() + FOUND_S
    while not events or log.stream.missing:
        log.link.wait_news(LOOK_S)
        if taken := log.take():
            events += taken
            until = monotonic() + FOUND_S
            progress(log.stream.wanted - 1, log.stream.seen)
        if monotonic() > until:
            why = log.problem or log.link.problem
            raise ValueError(
                f"no station shares a session at {log.link.address}{f': {why}' if why else ''}; "
                "the station in command shares its session with 'pa-console console --fleet'"
            )
    return events
