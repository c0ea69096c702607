"""What others on a TAK server report is in a session, as unverified contacts, and goes stale."""

import math
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from pa_console.schema.events.event import (
    MOST_CONTACTS,
    ContactLost,
    ContactReported,
    Event,
    Noticed,
    TakChanged,
    TelemetryReceived,
)
from pa_console.session.recording import Player
from pa_console.sim.checkpoint import Checkpoint
from pa_console.tak.cot_event import (
    MOST_BYTES,
    CotPoint,
    EventStream,
    deletion,
    element,
    read_event,
)
from pa_console.tak.reports import (
    HOLDS_MOST,
    MOST_IMPOSTORS,
    READ_A_SECOND,
    REPORTED_EVERY,
    TakReports,
)
from pa_console.tak.session_on_map import SessionOnMap, SiteOnMap
from tests.tak.heard import hearing, nothing, said
from tests.tak.taky_server import Taky

START = datetime(2026, 1, 1, tzinfo=UTC)
NEAR_M = 0.2


class Clock:
    """The clock of this machine, as the test sets it."""

    def __init__(self) -> None:
        self.now = START

    def __call__(self) -> datetime:
        """Return the time."""
        return self.now

    def pass_by(self, seconds: float) -> None:
        """Let time pass."""
        self.now += timedelta(seconds=seconds)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def reports(site: SiteOnMap, clock: Clock) -> TakReports:
    return TakReports(site, "tls://tak", now=clock)


def test_a_second_client_s_units_are_in_the_session_until_they_are_stale(
    site: SiteOnMap, taky: Taky
) -> None:
    with taky.client() as client, hearing(site, taky.url) as session:

        def tell(stale_s: float) -> None:
            friend = said(site, "ATAK-1", "a-f-G-U-C", (12.0, 30.0), "ALPHA 1", stale_s=stale_s)
            hostile = said(site, "ATAK-2", "a-h-G-E-V", (-40.0, -5.0), "RED 7", stale_s=stale_s)
            client.send(friend.xml() + hostile.xml())

        session.wait(lambda state: len(state.reported_contacts) == 2, lambda: tell(3.0))
        found = session.state.reported_contacts
        claimed = {uid: (one.callsign, one.affiliation, one.what) for uid, one in found.items()}
        assert claimed == {
            "ATAK-1": ("ALPHA 1", "friend", "ground unit"),
            "ATAK-2": ("RED 7", "hostile", "vehicle"),
        }
        assert math.dist(found["ATAK-1"].at, (12.0, 30.0)) < NEAR_M
        assert math.dist(found["ATAK-2"].at, (-40.0, -5.0)) < NEAR_M
        assert session.state.picture is None
        first = (
            "info TAK reported, not seen by our sensors: "
            "“ALPHA 1”, said to be friend, ground unit, at (12, 30)"
        )
        assert session.lines.count(first) == 1
        session.wait(lambda state: not state.reported_contacts, nothing)
        assert sum("no longer reported, report expired" in line for line in session.lines) == 2
    states = _replayed(session.events)
    assert {frozenset(one) for one in states} >= {frozenset(("ATAK-1", "ATAK-2")), frozenset()}


def _replayed(events: list[Event]) -> list[list[str]]:
    """Return which contacts a replay shows after each event."""
    player = Player.of(events)
    shown: list[list[str]] = []
    for number in range(len(events)):
        player.to_event(number)
        shown.append(list(player.state.reported_contacts))
    return shown


def test_a_server_that_comes_back_is_told_of_and_heard_again(
    site: SiteOnMap, tmp_path: Path
) -> None:
    with Taky(tmp_path) as server, hearing(site, server.url) as session:
        assert session.state.tak.connection is not None
        assert session.state.tak.connection.state == "connected"
        server.kill()
        session.wait(lambda state: _state(state.tak.connection) == "away", nothing)
        assert any(line.startswith("warning TAK no connection to tcp://") for line in session.lines)
        server.start()
        session.wait(lambda state: _state(state.tak.connection) == "connected", nothing)
        assert session.lines[-1].startswith("info TAK connected to tcp://")
        with server.client() as client:
            unit = said(site, "ATAK-1", "a-f-G", (0.0, 0.0))
            session.wait(
                lambda state: "ATAK-1" in state.reported_contacts, lambda: client.send(unit.xml())
            )
            session.wait(
                lambda state: not state.reported_contacts,
                lambda: client.send(deletion("ATAK-1", "a-f-G", datetime.now(UTC)).xml()),
            )
    assert "no longer reported, removed by its sender" in session.lines[-1]


def _state(connection: TakChanged | None) -> str:
    return connection.state if connection is not None else ""


def test_whoever_speaks_as_ours_is_told_of_and_is_no_contact(site: SiteOnMap, taky: Taky) -> None:
    sim = Checkpoint(site.world, seed=1)
    with taky.client() as client, hearing(site, taky.url) as session:
        on_map = SessionOnMap(site, session.connection, every_s=0.0)
        data = TelemetryReceived(picture=sim.picture())
        on_map.take(Event(t=datetime.now(UTC), tick=0, data=data))
        ours = client.wait(lambda seen: any("Drone_T04" in (e.get("uid") or "") for e in seen))
        assert ours
        fake = said(site, site.uid("Drone_T04"), "a-f-A-M-H-Q", (50.0, 0.0), "Drone_T04")
        session.wait(
            lambda state: state.notices[-1].level == "alarm", lambda: client.send(fake.xml())
        )
    assert session.lines[-1] == "alarm TAK another sender on the TAK server claims to be Drone_T04"
    assert not session.state.reported_contacts


def test_what_a_server_sends_back_is_no_impostor(
    site: SiteOnMap, reports: TakReports, clock: Clock
) -> None:
    ours = said(site, site.uid("Drone_T04"), "a-f-A-M-H-Q", (1.0, 1.0), "Drone_T04", now=clock.now)
    gone = deletion(site.uid("track.Vehicle_01"), "a-u-G-E-V", clock.now)
    for event in (ours, gone):
        reports.sent(event)
        reports.received(event.xml())
    before = said(site, site.uid("Ugv_T01"), "a-f-G", (1.0, 1.0), stale_s=3.0, now=START)
    clock.pass_by(1.0)
    later = TakReports(site, "tls://tak", now=clock)
    later.received(before.xml())
    replayed = said(site, "pa-console-replay.sea.Drone_T04", "a-f-A", (1.0, 1.0), now=clock.now)
    reports.received(replayed.xml())
    assert not reports.news()
    assert not later.news(), "an earlier session of the site told that"


@pytest.mark.parametrize(
    "changed",
    [
        {"type": "a-h-A-M-H-Q"},
        {"time": START + timedelta(seconds=1)},
        {"stale": START + timedelta(hours=1)},
        {"point": CotPoint(2.0001, -30.0)},
        {"detail": (element("contact", {"callsign": "RED 7"}),)},
    ],
)
def test_whoever_changes_what_we_have_said_is_an_impostor(
    site: SiteOnMap, reports: TakReports, clock: Clock, changed: dict[str, Any]
) -> None:
    uid = site.uid("Drone_T04")
    ours = said(site, uid, "a-f-A-M-H-Q", (1.0, 1.0), "Drone_T04", stale_s=3.0, now=clock.now)
    reports.sent(ours)
    reports.received(ours.xml())
    assert not reports.news()
    reports.received(replace(ours, **changed).xml())
    assert [data.kind for data in reports.news()] == ["noticed"]


def test_impostors_of_many_are_told_of_a_few_times(
    site: SiteOnMap, reports: TakReports, clock: Clock
) -> None:
    for number in range(100):
        fake = said(site, site.uid(f"Drone_T{number:02}"), "a-f-A", (0.0, 0.0), now=clock.now)
        reports.received(fake.xml())
        reports.received(deletion(site.uid("Ugv_T01"), "a-f-G", clock.now).xml())
    told = [data for data in reports.news() if isinstance(data, Noticed)]
    assert len(told) == MOST_IMPOSTORS + 1
    assert {data.level for data in told} == {"alarm"}
    assert told[-1].text.endswith("claims to be other things of this site too")
    assert not reports.news()


def test_a_position_is_told_every_few_seconds_and_a_loss_at_once(
    site: SiteOnMap, reports: TakReports, clock: Clock
) -> None:
    told: list[float] = []
    for second in range(30):
        unit = said(site, "U", "a-f-G", (second, 0.0), stale_s=2.0, now=clock.now)
        reports.received(unit.xml())
        told += [data.contact.at[0] for data in reports.news() if isinstance(data, ContactReported)]
        clock.pass_by(1.0)
    assert told == pytest.approx(range(0, 30, int(REPORTED_EVERY.total_seconds())), abs=0.1)
    clock.pass_by(1.0)
    assert reports.news() == [ContactLost(uid="U", reason="stale")]
    assert not reports.news()


def test_who_stands_still_is_told_once_and_a_claim_that_changes_again(
    site: SiteOnMap, reports: TakReports, clock: Clock
) -> None:
    told: list[str] = []
    for second in range(30):
        kind = "a-f-G" if second < 20 else "a-h-G"
        reports.received(said(site, "U", kind, (1.0, 0.0), now=clock.now).xml())
        reports_told = [data for data in reports.news() if isinstance(data, ContactReported)]
        told += [data.contact.affiliation for data in reports_told]
        clock.pass_by(1.0)
    assert told == ["friend", "hostile"]


def test_a_report_for_ever_holds_ten_minutes(
    site: SiteOnMap, reports: TakReports, clock: Clock
) -> None:
    reports.received(said(site, "U", "a-f-G", (0.0, 0.0), stale_s=1e9, now=clock.now).xml())
    assert len(reports.news()) == 1
    clock.pass_by(HOLDS_MOST.total_seconds() - 1.0)
    assert not reports.news()
    clock.pass_by(2.0)
    assert reports.news() == [ContactLost(uid="U", reason="stale")]


def test_a_clock_that_is_set_back_lets_nothing_hold_for_longer(
    site: SiteOnMap, reports: TakReports, clock: Clock
) -> None:
    reports.received(said(site, "U", "a-f-G", (0.0, 0.0), stale_s=60.0, now=clock.now).xml())
    assert len(reports.news()) == 1
    clock.pass_by(-24 * 3600.0)
    assert reports.news() == [ContactLost(uid="U", reason="stale")]


@pytest.mark.parametrize("at", [(2000.0, 0.0), (0.0, -2e6), (1e7, 1e7)])
def test_what_is_beyond_the_site_is_counted_and_a_contact_may_leave(
    site: SiteOnMap, reports: TakReports, clock: Clock, at: tuple[float, float]
) -> None:
    reports.received(said(site, "U", "a-f-G", (0.0, 0.0), now=clock.now).xml())
    assert len(reports.news()) == 1
    for _ in range(5):
        reports.received(said(site, "U", "a-f-G", at, now=clock.now).xml())
    lost, left_out = reports.news()
    assert lost == ContactLost(uid="U", reason="left")
    assert left_out.model_dump() == {
        "kind": "contacts_left_out", "outside": 1, "too_many": 0, "unreadable": 0,
    }  # fmt: skip


def test_the_other_side_of_the_earth_is_not_here(reports: TakReports, clock: Clock) -> None:
    """Seen along the plumb line it lies right below the site."""
    point = 'lat="-2.0" lon="150.0"'
    now = clock.now.isoformat()
    reports.received(
        f'<event uid="U" type="a-f-G" time="{now}" stale="2036-01-01T00:00:00Z"><point {point}/>'
        "</event>".encode()
    )
    assert {data.kind for data in reports.news()} == {"contacts_left_out"}


def test_a_thousand_contacts_are_a_few(site: SiteOnMap, reports: TakReports, clock: Clock) -> None:
    events, lines = 0, 0
    for second in range(60):
        for number in range(READ_A_SECOND + 50):
            unit = said(site, f"U{second}-{number}", "a-h-G", (0.0, 0.0), stale_s=2, now=clock.now)
            reports.received(unit.xml())
        clock.pass_by(1.0)
        told = reports.news()
        events += len(told)
        lines += sum(isinstance(data, ContactReported | ContactLost) for data in told)
    minute = 60 / 10
    assert MOST_CONTACTS <= lines <= 2 * (MOST_CONTACTS + minute)
    assert events - lines <= 2, "what is left out is told once a minute"


def test_a_flood_is_not_read(site: SiteOnMap, reports: TakReports, clock: Clock) -> None:
    unit = said(site, "U", "a-h-G", (0.0, 0.0), now=clock.now).xml()
    reports.received(unit * (READ_A_SECOND + 50))
    [_, left_out] = reports.news()
    assert left_out.model_dump()["too_many"] == 50


def test_without_contacts_nothing_is_read(site: SiteOnMap, clock: Clock) -> None:
    reports = TakReports(site, "tls://tak", contacts=False, now=clock)
    reports.connection_changed("connected", "connected to tls://tak")
    reports.received(said(site, site.uid("Drone_T04"), "a-f-G", (0.0, 0.0), now=clock.now).xml())
    reports.received(b"<event></event>")
    assert [data.kind for data in reports.news()] == ["tak"]


def test_events_are_found_however_they_are_cut() -> None:
    stream, given = EventStream(), b"<?xml?><event a='1'></event>\n<event b='2'><x/></event>"
    found = [document for byte in given for document in stream.feed(bytes((byte,)))]
    assert found == [b"<event a='1'></event>", b"<event b='2'><x/></event>"]


def test_an_event_without_an_end_is_given_up_and_the_next_one_is_found() -> None:
    stream = EventStream()
    found = [each for _ in range(100) for each in stream.feed(b"<event " + b"x" * MOST_BYTES)]
    assert not found
    assert stream.feed(b"</event><event></event>") == [b"<event></event>"]
    assert stream.broken == 1
    assert stream.feed(b"<event>" + b"x" * MOST_BYTES + b"</event><event/></event>") == [
        b"<event/></event>"
    ]
    assert stream.broken == 2


@pytest.mark.parametrize(
    ("type_", "affiliation", "what"),
    [
        ("a-f-G-U-C", "friend", "ground unit"),
        ("a-h-G-E-V-A", "hostile", "vehicle"),
        ("a-n-A-C-F", "neutral", "aircraft"),
        ("a-u-G-I", "unknown", "installation"),
        ("a-s-G", "suspect", "ground object"),
        ("a-.-S-X", "other", "vessel"),
        ("a-p", "pending", "object"),
    ],
)
def test_types_are_read_as_their_sender_means_them(type_: str, affiliation: str, what: str) -> None:
    heard = read_event(
        f'<event uid="U" type="{type_}" time="2026-01-01T00:00:00" stale="2026-01-01T00:01:00Z">'
        '<point lat="1" lon="2" ce="9999999"/></event>'.encode()
    )
    assert heard is not None
    assert (heard.affiliation, heard.what, heard.ce) == (affiliation, what, None)
