"""A session that is shared over a bus arrives as it is in the log, or not at all."""

from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets import authorization as auth
from pa_console.fleets.vda5050.additions import RecordsAsked, SessionRecords, pack
from pa_console.fleets.vda5050.sharing import SharedSession
from pa_console.fleets.vda5050.wire import Numbers
from pa_console.schema.events.event import Event, Noticed
from pa_console.session.log.writer import LogWriter
from pa_console.station.joined.shared_log import NotBelievedError, RecordStream
from tests.fleets.keyring import KEYS, PUBLIC, REVOCATION, SIGNED_ROSTER, TO_NORTH, Clock

AT = datetime(2026, 1, 1, tzinfo=UTC)
SITE = "yard"
BOMB = pack(b"\n" * (64 << 20))


def event(number: int) -> Event:
    """One event; some are longer than a message of many records would be."""
    text = f"{number} \u2603 " + "x" * (300_000 if number % 20 == 3 else 0)
    return Event(t=AT, tick=number, data=Noticed(level="info", subject="s", text=text))


class Sharing:
    """A log that is written and shared in the name of a station."""

    def __init__(self, folder: Path, clock: Clock, name: str = "north", key: str = "") -> None:
        self._log = LogWriter(folder / f"{name}{key}.jsonl", "S")
        signer = KEYS[key or name]
        self.shared = SharedSession(
            "S", name, self._log.path, lambda records: auth.sign_records(signer, records, clock())
        )
        self._log.on_record = self.shared.add
        self.written: list[Event] = []

    def write(self, count: int) -> None:
        """Log so many events more."""
        for _ in range(count):
            self.written.append(event(len(self.written)))
            self._log.append(self.written[-1])

    def messages(self) -> list[SessionRecords]:
        """What is published now."""
        return [SessionRecords.read(sent.payload) for sent in self.shared.step(SITE, AT)]

    def asked(self, first: int) -> list[SessionRecords]:
        """What comes of asking for the records from `first` on."""
        self._log.flush()
        header = Numbers().header(self.shared.identity, RecordsAsked.TOPIC, AT)
        self.shared.ask(RecordsAsked(**header, session="S", first=first))
        return self.messages()


def trust() -> auth.Trust:
    found = auth.Trust(PUBLIC["owner"])
    for message in (SIGNED_ROSTER, REVOCATION, TO_NORTH):
        assert found.take(message) == ""
    return found


def changed(message: SessionRecords, how: str, clock: Clock) -> tuple[str, SessionRecords]:
    """A message as somebody else has made it, and from whom it claims to be."""
    lines = b"\n".join(message.lines()) + b"\n"
    match how:
        case "text":
            update = {"packed": pack(lines.replace(b"s", b"t", 1))}
        case "cut":
            update = {"packed": message.packed[:-8]}
        case "bomb":
            update = {"packed": BOMB}
        case "number":
            update = {"first": message.first + 1, "last": message.last + 1}
        case "session":
            update = {"session": "other"}
        case "eve":
            claims = auth.Records("S", message.first, message.last, "0" * 64)
            update = {"signature": auth.sign_records(KEYS["eve"], claims, clock())}
        case _:
            update = {}
    return ("south" if how == "south" else "north"), message.model_copy(update=update)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 30),
            st.lists(
                st.sampled_from(
                    ("true", "true", "lost", "twice", "text", "cut", "bomb", "number", "session",
                     "eve", "south", "late")
                ),
                min_size=1, max_size=3,
            ),
        ),
        max_size=6,
    )
)  # fmt: skip
def test_what_arrives_is_the_log_from_its_beginning_whatever_else_is_sent(
    tmp_path_factory: pytest.TempPathFactory, acts: list[tuple[int, list[str]]]
) -> None:
    clock = Clock()
    sharing = Sharing(tmp_path_factory.mktemp("log"), clock)
    stream, arrived = RecordStream(trust(), clock), list[Event]()

    def deliver(station: str, message: SessionRecords) -> None:
        with suppress(NotBelievedError):
            arrived.extend(stream.take(station, message))

    for count, ways in acts:
        sharing.write(count)
        for message in sharing.messages():
            for how in ways:
                if how == "late":
                    clock.at += 100.0
                if how != "lost":
                    deliver(*changed(message, how, clock))
        assert arrived == sharing.written[: len(arrived)]
        assert stream.missing == max(stream.seen - len(arrived), 0)
    sharing.write(1)
    for message in sharing.messages():
        deliver("north", message)
    while stream.missing:
        for message in sharing.asked(stream.wanted):
            deliver("north", message)
    assert arrived == sharing.written


@pytest.fixture
def streams(tmp_path: Path) -> tuple[Sharing, RecordStream]:
    clock = Clock()
    return Sharing(tmp_path, clock), RecordStream(trust(), clock)


def test_a_session_of_a_station_that_is_not_in_command_is_not_followed(tmp_path: Path) -> None:
    clock = Clock()
    south = Sharing(tmp_path, clock, "south")
    south.write(2)
    with pytest.raises(NotBelievedError, match="north is in command since epoch 1"):
        RecordStream(trust(), clock).take("south", south.messages()[0])


def test_a_revoked_station_is_not_believed(tmp_path: Path) -> None:
    clock = Clock()
    lost = Sharing(tmp_path, clock, "lost")
    lost.write(2)
    with pytest.raises(NotBelievedError, match="lost is not a station of this site"):
        RecordStream(trust(), clock).take("lost", lost.messages()[0])


def test_old_records_are_read_from_the_file(streams: tuple[Sharing, RecordStream]) -> None:
    sharing, stream = streams
    sharing.write(700)
    published = sharing.messages()
    assert stream.take("north", published[-1]) == []
    assert stream.missing == 700
    arrived: list[Event] = []
    while stream.missing:
        for message in sharing.asked(stream.wanted):
            arrived += stream.take("north", message)
    assert arrived == sharing.written
