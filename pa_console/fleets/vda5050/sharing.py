"""The messages with which a station shares a session's records and the site's signed messages."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from pathlib import Path

from pa_console.fleets.authorization import Records
from pa_console.fleets.vda5050 import additions
from pa_console.fleets.vda5050.additions import MANUFACTURER, RecordsAsked, SessionRecords, pack
from pa_console.fleets.vda5050.broker import OutgoingMessage
from pa_console.fleets.vda5050.wire import MOST_BYTES, Identity, Numbers, Topic

RECENT = 512
"""The number of records kept in memory; older ones are read from the file."""

PIECE_BYTES = 1 << 20
"""The approximate size of the records in one message, in bytes."""

MOST_ASKED = 16
"""The largest number of waiting requests; beyond it, the oldest are dropped."""

Vouch = Callable[[Records], str]
"""A function that returns the station's signature of shared records."""


class SharedSession:
    """The log of a session, as published by the station called `station`.

    `path` is the file of the log, which must be empty at the start.
    """

    def __init__(self, session: str, station: str, path: Path, vouch: Vouch) -> None:
        self.identity, self.session = Identity(MANUFACTURER, station), session
        self._path, self._vouch, self._numbers = path, vouch, Numbers()
        self._ends = [0]
        """The offset of the end of each record in the file, in bytes."""
        self._hashes = [""]
        self._recent: deque[bytes] = deque(maxlen=RECENT)
        self._told = 0
        """The number of records published."""
        self._asked: deque[int] = deque(maxlen=MOST_ASKED)

    def add(self, line: str, digest: str) -> None:
        """Add a record of the log, without its line end, and its hash."""
        text = line.encode() + b"\n"
        self._recent.append(text)
        self._ends.append(self._ends[-1] + len(text))
        self._hashes.append(digest)

    def ask(self, message: RecordsAsked) -> None:
        """Record a request for missing records; a later step sends one piece of them."""
        has_records = message.session == self.session and 1 <= message.first < len(self._ends)
        if has_records and message.first not in self._asked:
            self._asked.append(message.first)

    def step(self, site: str, now: datetime) -> Iterator[OutgoingMessage]:
        """Yield the messages to publish now: all new records, and one requested piece."""
        while self._told < len(self._ends) - 1:
            last = self._piece(self._told + 1)
            yield from self._message(site, now, self._told + 1, last)
            self._told = last
        if self._asked:
            first = self._asked.popleft()
            yield from self._message(site, now, first, self._piece(first))

    def _piece(self, first: int) -> int:
        """Return the number of the last record in a message that begins with record `first`."""
        last, limit = first, self._ends[first - 1] + PIECE_BYTES
        while last + 1 < len(self._ends) and self._ends[last + 1] <= limit:
            last += 1
        return last

    def _message(
        self, site: str, now: datetime, first: int, last: int
    ) -> Iterator[OutgoingMessage]:
        """Yield the message with these records, or nothing if they cannot be read or are too large.

        Clients request missing records again.
        """
        lines = self._lines(first, last)
        packed = pack(lines)
        if not lines or len(packed) > MOST_BYTES * 3 // 4:
            return
        message = SessionRecords(
            **self._numbers.header(self.identity, SessionRecords.TOPIC, now),
            session=self.session,
            first=first,
            last=last,
            packed=packed,
            signature=self._vouch(Records(self.session, first, last, self._hashes[last])),
        )
        topic = Topic(site, self.identity, SessionRecords.TOPIC)
        yield OutgoingMessage(str(topic), message.write(), qos=1)

    def _lines(self, first: int, last: int) -> bytes:
        """Return the lines with their line ends; empty if the file lacks one of them."""
        oldest = len(self._ends) - len(self._recent)
        if first >= oldest:
            return b"".join(list(self._recent)[first - oldest : last - oldest + 1])
        try:
            with self._path.open("rb") as file:
                file.seek(self._ends[first - 1])
                content = file.read(self._ends[last] - self._ends[first - 1])
        except OSError:
            return b""
        return content if content.endswith(b"\n") else b""


def signed_messages(
    site: str, messages: Mapping[str, str], numbers: Numbers, sent: datetime
) -> list[OutgoingMessage]:
    """Return messages that retain the signed `messages` (by kind), in the order receivers need."""
    outgoing: list[OutgoingMessage] = []
    for kind in additions.SIGNED:
        if (message := messages.get(kind.TOPIC)) is not None:
            header = numbers.header(additions.TRUST, kind.TOPIC, sent)
            topic = Topic(site, additions.TRUST, kind.TOPIC)
            outgoing.append(
                OutgoingMessage(str(topic), kind(**header, message=message).write(), 1, retain=True)
            )
    return outgoing
