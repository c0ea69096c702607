"""The log of another station's session as it arrives over a bus, checked record by record."""

from collections.abc import Callable

from pa_console.fleets.authorization import RefusedError, Trust
from pa_console.fleets.vda5050.session_messages import SessionRecords
from pa_console.fleets.vda5050.wire import UnreadableError
from pa_console.schema.events.event import Event
from pa_console.session.log.chain import LogRecord, link_problem, parse


class NotBelievedError(ValueError):
    """Records of another session, or without a valid signature; the text is the reason."""


class RecordStream:
    """Takes the records of one session in, in order and without a gap.

    It follows the first session that the station in command vouches for. Each message is signed by
    that station, and each record holds the hash of the one before.
    """

    def __init__(self, trust: Trust, now: Callable[[], float]) -> None:
        """`trust` is the site's; `now` is in seconds since 1970."""
        self._trust, self._now = trust, now
        self.station, self.session = "", ""
        """The name of the station in the roster, and the id of its session; "" before the first."""
        self._last: LogRecord | None = None
        self.seen = 0
        """The number of the last record announced by the station."""

    @property
    def wanted(self) -> int:
        """The number of the next record."""
        return int(self._last.fields["seq"]) + 1 if self._last is not None else 1

    @property
    def head(self) -> str:
        """The hash of the last record that is here, '' before the first."""
        return self._last.hash if self._last is not None else ""

    @property
    def missing(self) -> int:
        """The number of announced records that are missing here."""
        return max(self.seen - self.wanted + 1, 0)

    def take(self, station: str, message: SessionRecords) -> list[Event]:
        """Return the events of the records that come next; none when one before them is missing.

        Raises NotBelievedError, and takes nothing, for what is not the log of this session.
        """
        try:
            vouched = self._trust.records(station, message.signature, self._now())
        except RefusedError as refused:
            raise NotBelievedError(str(refused)) from refused
        said = message.session, message.first, message.last
        if (vouched.session, vouched.first, vouched.last) != said:
            raise NotBelievedError(f"{station} vouches for other records than these")
        if not self.session:
            self._follow(station, vouched.session)
        if station != self.station:
            raise NotBelievedError(f"{station} shares a session, too")
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
        """Return the events of a message whose hashes lead from the last record to `head`."""
        last, events = self._last, list[Event]()
        try:
            lines = message.lines()
            if len(lines) != message.last - message.first + 1:
                raise NotBelievedError("it has not as many records as it says")
            for line in lines[self.wanted - message.first :]:
                record = parse(line)
                problem = link_problem(record, last)
                if problem or record.fields["session"] != self.session:
                    raise NotBelievedError(problem or "a record is of another session")
                last = record
                events.append(record.event)
        except NotBelievedError:
            raise
        except UnreadableError as error:
            raise NotBelievedError(str(error)) from error
        except ValueError as error:
            raise NotBelievedError(f"a record cannot be read: {error}") from error
        if last is None or last.hash != head:
            raise NotBelievedError("its last record is not the one that the station vouches for")
        self._last = last
        return events
