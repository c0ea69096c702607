"""What a second client of a TAK server sees, and that no server delays or ends a session."""

import math
import socket
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from queue import SimpleQueue
from threading import Event as Flag
from xml.etree.ElementTree import Element

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
from cryptography.hazmat.primitives.serialization import pkcs12

from pa_console.fleets.vda5050.broker import CA_FILE
from pa_console.fleets.vda5050.site_files import BROKER, STATION, write_site
from pa_console.schema.events.event import Event, Noticed, SessionEnded, TelemetryReceived
from pa_console.schema.incident import SpawnTrack
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.tak.connection import (
    PASSWORD_VARIABLE,
    Certificate,
    Outbox,
    TakConnection,
    TakServer,
)
from pa_console.tak.cot_event import DELETE, CotEvent, element
from pa_console.tak.session_on_map import InBackground, SessionOnMap, SiteOnMap
from tests.fleets.broker import free_port
from tests.sim.running import run
from tests.tak.taky_server import LIMIT_S, LOOPBACK, Client, Taky

NEAR_M = 0.1
MANY = 20_000
"""More events than the buffers of two sockets and an outbox hold."""
RETRY_S = 0.05


@contextmanager
def connected(url: str, certificate: Certificate | None = None) -> Generator["Session"]:
    """Yield a connection and what it says of itself."""
    said: SimpleQueue[str] = SimpleQueue()
    server = TakServer.parse(url, certificate)
    with TakConnection(server, "pa-console.sea.station", said.put, RETRY_S) as connection:
        yield Session(connection, said)


class Session:
    """Sends pictures of a world as they are now."""

    def __init__(self, connection: TakConnection, said: "SimpleQueue[str]") -> None:
        self.connection, self._said = connection, said

    def shown(self, site: SiteOnMap) -> Callable[[Picture], None]:
        """Return what shows a picture."""
        on_map = SessionOnMap(site, self.connection, every_s=0.0)

        def show(picture: Picture) -> None:
            data = TelemetryReceived(picture=picture)
            on_map.take(Event(t=datetime.now(UTC), tick=0, data=data))

        return show

    def says(self, words: str) -> str:
        """Wait for a line that has `words` in it."""
        while words not in (line := self._said.get(timeout=LIMIT_S)):
            pass
        return line


def told(client: Client, *ends: str) -> dict[str, Element]:
    """Wait for events whose uids end so; return the last of each uid."""

    def all_came(seen: Sequence[Element]) -> bool:
        uids = [event.get("uid", "") for event in seen]
        return all(any(uid.endswith(end) for uid in uids) for end in ends)

    return {event.get("uid", ""): event for event in client.wait(all_came)}


def place(event: Element) -> tuple[float, float]:
    point = event.find("point")
    assert point is not None
    return float(point.get("lat", "nan")), float(point.get("lon", "nan"))


def moment(event: Element, name: str) -> datetime:
    return datetime.fromisoformat(event.get(name, ""))


def test_a_second_client_sees_everybody_where_they_are(site: SiteOnMap, taky: Taky) -> None:
    sim = Checkpoint(site.world, seed=1)
    sim.inject(SpawnTrack(gate="WestGate", distance_m=60.0))
    run(sim, 4.0)
    picture = sim.picture()
    with taky.client() as client, connected(taky.url) as session:
        session.shown(site)(picture)
        seen = told(client, *picture.assets, *picture.tracks, "frame.Base")
    for name, asset in picture.assets.items():
        event = seen[f"pa-console.sea.{name}"]
        assert math.dist(site.geography.metres(*place(event)), asset.position) < NEAR_M
        contact = event.find("detail/contact")
        assert contact is not None
        assert contact.get("callsign") == name
        assert event.find("detail/status") is not None
        lasts = moment(event, "stale") - moment(event, "time")
        assert lasts == timedelta(seconds=site.world.stale_s)
    for name, track in picture.tracks.items():
        event = seen[f"pa-console.sea.track.{name}"]
        assert event.get("type") == "a-u-G-E-V"
        assert math.dist(site.geography.metres(*place(event)), track.position) < NEAR_M


def test_who_comes_later_sees_the_session_and_its_end(site: SiteOnMap, taky: Taky) -> None:
    sim = Checkpoint(site.world, seed=1)
    run(sim, 2.0)
    with connected(taky.url) as session, taky.client() as client:
        on_map = SessionOnMap(site, session.connection, every_s=0.0)
        data = TelemetryReceived(picture=sim.picture())
        on_map.take(Event(t=datetime.now(UTC), tick=0, data=data))
        told(client, "Drone_T01", "perimeter")
        on_map.take(Event(t=datetime.now(UTC), tick=0, data=SessionEnded(reason="over")))
        gone = told(client, "perimeter.deleted", "zone.Depot.deleted", "frame.Base.deleted")
    assert gone["pa-console.sea.perimeter.deleted"].get("type") == DELETE


def test_a_server_that_comes_back_is_told_everything_again(site: SiteOnMap, tmp_path: Path) -> None:
    sim = Checkpoint(site.world, seed=1)
    run(sim, 2.0)
    picture = sim.picture()
    with Taky(tmp_path) as server, connected(server.url) as session:
        show = session.shown(site)
        session.says("connected to")
        with server.client() as client:
            show(picture)
            told(client, "frame.Base", "Drone_T01")
        server.kill()
        lost = session.says("connection")
        assert "tcp://" in lost
        show(picture)
        server.start()
        with server.client() as client:
            session.says("connected to")
            show(picture)
            told(client, "frame.Base", "Drone_T01")


def test_a_server_that_is_not_there_is_told_of_once(site: SiteOnMap) -> None:
    sim = Checkpoint(site.world, seed=1)
    with connected(f"tcp://{LOOPBACK}:{free_port()}") as session:
        session.says("it is tried again")
        session.shown(site)(sim.picture())
        waiting = len(session.connection.outbox)
    assert waiting > len(sim.picture().assets)
    assert not session.connection.sent


def test_a_server_that_reads_nothing_delays_nobody() -> None:
    """More comes than the server takes: the newest of each thing is kept, the oldest dropped."""
    remarks = element("remarks", {}, "x" * 2000)
    with socket.socket() as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.bind((LOOPBACK, 0))
        deaf.listen()
        with connected(f"tcp://{LOOPBACK}:{deaf.getsockname()[1]}") as session:
            session.says("connected to")
            for number in range(MANY):
                session.connection.send((_event(f"thing-{number}", remarks),))
        connection = session.connection
    assert connection.outbox.dropped > 0
    assert MANY - connection.sent - connection.outbox.dropped - len(connection.outbox) in (0, 1)


def test_what_a_server_sends_is_thrown_away(site: SiteOnMap) -> None:
    """Neither junk nor orders nor an endless document do anything, and nobody answers them."""
    order = b'<event type="t-x-c-m" uid="x"><detail><remarks>stop</remarks></detail></event>'
    bomb = b'<!DOCTYPE a [<!ENTITY b "' + b"x" * 10_000 + b'">]><a>' + b"&b;" * 10_000
    answered = bytearray()
    heard = threading.Event()

    def hostile(listening: socket.socket) -> None:
        taken, _ = listening.accept()
        with taken:
            for _ in range(100):
                taken.sendall(order + bomb + b"\xff\x00<" * 100)
            while b"Robot_T02" not in answered:
                answered.extend(taken.recv(65_536))
            heard.set()

    sim = Checkpoint(site.world, seed=1)
    with socket.create_server((LOOPBACK, 0)) as listening:
        thread = threading.Thread(target=hostile, args=(listening,), daemon=True)
        thread.start()
        with connected(f"tcp://{LOOPBACK}:{listening.getsockname()[1]}") as session:
            session.shown(site)(sim.picture())
            assert heard.wait(LIMIT_S)
        thread.join(LIMIT_S)
    uids = [part.split(b'uid="')[1] for part in bytes(answered).split(b"<event")[1:-1]]
    assert uids
    assert all(uid.startswith(b"pa-console.sea.") for uid in uids)


def test_the_outbox_keeps_the_newest_of_each_thing_and_drops_the_oldest() -> None:
    outbox = Outbox(most=3)
    outbox.put(_event(uid) for uid in "abcab")
    assert [event.uid for event in (outbox.take(), outbox.take()) if event] == ["c", "a"]
    outbox.put(_event(uid) for uid in "xyz")
    assert outbox.dropped == 1
    left: list[str] = []
    while (event := outbox.take()) is not None:
        left.append(event.uid)
    assert left == ["x", "y", "z"]


def test_tls_shows_a_certificate_and_trusts_no_other_authority(
    site: SiteOnMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, others = tmp_path / "ours", tmp_path / "others"
    for folder in (ours, others):
        write_site(folder, "sea", (), (LOOPBACK, "localhost"), 8883)
    sim = Checkpoint(site.world, seed=1)
    run(sim, 2.0)
    tls = {"ca": ours / CA_FILE, "cert": ours / f"{BROKER}.crt", "key": ours / f"{BROKER}.key"}
    with Taky(tmp_path, tls) as server:
        url = server.url.replace(LOOPBACK, "localhost")
        own = Certificate(ours / f"{STATION}.crt", ours / f"{STATION}.key", ours / CA_FILE)
        with server.client() as client, connected(url, own) as session:
            session.says("connected to")
            session.shown(site)(sim.picture())
            told(client, "Drone_T01")
        bundle = tmp_path / "station.p12"
        bundle.write_bytes(_pkcs12(own, b"50% off"))
        with pytest.raises(ValueError, match=PASSWORD_VARIABLE):
            Certificate.of(bundle, None, own.ca)
        monkeypatch.setenv(PASSWORD_VARIABLE, "50% off")
        with connected(url, Certificate.of(bundle, None, own.ca)) as session:
            session.says("connected to")
        stranger = Certificate(own.certificate, own.key, others / CA_FILE)
        with connected(url, stranger) as session:
            assert "certificate" in session.says("no connection")
        mixed = Certificate(own.certificate, others / f"{STATION}.key", own.ca)
        with pytest.raises(ValueError, match=r"station\.crt: cannot be used"):
            TakConnection(TakServer.parse(url, mixed), "u", print)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("http://h:1", "not an address of a TAK server"),
        ("tcp://", "not an address"),
        ("tcp://h:99999", "out of range"),
        ("tcp://h/path", "only host and port"),
        ("tls://h", "--tls-cert"),
        ("tcp://[::1]:8087", "IPv4"),
    ],
)
def test_what_is_no_address_is_refused(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        TakServer.parse(text)


def test_whoever_can_read_along_is_known() -> None:
    assert TakServer.parse("tcp://192.0.2.7").open_to_all
    assert TakServer.parse("tcp://tak.example").open_to_all
    assert not TakServer.parse("tcp://127.0.0.1").open_to_all
    assert not TakServer.parse("tcp://localhost").open_to_all


def _pkcs12(certificate: Certificate, password: bytes) -> bytes:
    """Return certificate and key as one file, as TAK servers give them out."""
    key = serialization.load_pem_private_key(certificate.key.read_bytes(), None)
    assert isinstance(key, EllipticCurvePrivateKey)
    return pkcs12.serialize_key_and_certificates(
        b"station",
        key,
        x509.load_pem_x509_certificate(certificate.certificate.read_bytes()),
        None,
        serialization.BestAvailableEncryption(password),
    )


def _event(uid: str, *detail: Element) -> CotEvent:
    now = datetime.now(UTC)
    return CotEvent(uid, "a-u-G", now, now, detail=detail)


SOON_S = 300.0


def pictures(world: World) -> Callable[[int], Event]:
    picture = Checkpoint(world, seed=1).picture()

    def of(tick: int) -> Event:
        data = TelemetryReceived(picture=picture.model_copy(update={"tick": tick}))
        return Event(t=datetime.now(UTC), tick=tick, data=data)

    return of


def test_of_the_pictures_that_wait_only_the_newest_is_shown(world: World) -> None:
    of, begun, go_on = pictures(world), Flag(), Flag()
    shown: list[Event] = []

    def show(event: Event) -> None:
        begun.set()
        assert go_on.wait(SOON_S)
        shown.append(event)

    told: list[str] = []
    with InBackground(show, told.append) as background:
        background.take(of(1))
        assert begun.wait(SOON_S)
        for tick in range(2, 100):
            background.take(of(tick))
        notice = Noticed(level="info", subject="s", text="t")
        background.take(Event(t=datetime.now(UTC), tick=99, data=notice))
        background.take(Event(t=datetime.now(UTC), tick=99, data=SessionEnded(reason="over")))
        go_on.set()
    kinds = [(event.tick, event.data.kind) for event in shown]
    assert kinds == [(1, "telemetry"), (99, "telemetry"), (99, "session_ended")]
    assert not told


def test_a_fault_is_told_once_and_reaches_no_session(world: World) -> None:
    of = pictures(world)
    told: SimpleQueue[str] = SimpleQueue()

    def show(event: Event) -> None:
        raise ZeroDivisionError(f"picture {event.tick}")

    with InBackground(show, told.put) as background:
        background.take(of(1))
        assert told.get(timeout=SOON_S) == "nothing more is shown: ZeroDivisionError: picture 1"
        for tick in range(2, 10):
            background.take(of(tick))
    assert told.empty()
