"""`pa-console tak`, and `--tak`: a session on a TAK map, and what others report there."""

import json
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

import pytest

from pa_console.cli.sessions.on_map import on_map
from pa_console.resources import find_data
from pa_console.schema.world import Origin
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.geography import Geography
from pa_console.sim.worlds.world_file import load_world
from pa_console.tak.session_on_map import SiteOnMap
from tests.cli.inside import Call
from tests.fleets.broker import free_port
from tests.golden.sessions import played
from tests.tak.heard import said
from tests.tak.taky_server import LOOPBACK, Taky

SEA = ("--origin", "2.0,-30.0,15,12")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    played("stopped", folder)
    return folder / "stopped.jsonl"


@pytest.fixture(scope="module")
def taky(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Taky]:
    with Taky(tmp_path_factory.mktemp("taky")) as server:
        yield server


def test_a_replay_is_on_the_map_and_is_seen_to_be_one(call: Call, log: Path, taky: Taky) -> None:
    with taky.client() as client:
        ended: list[int] = []
        watching = threading.Thread(
            target=lambda: client.wait(lambda _: bool(ended) and _over(client.seen))
        )
        watching.start()
        done = call("tak", "--server", taky.url, "--replay", str(log), *SEA, "--speed", "32")
        ended.append(done.code)
        watching.join(30)
    assert (done.code, done.out) == (0, "")
    assert "connected to" in done.err
    assert "events sent" in done.err
    assets = [event for event in client.seen if event.get("type", "").startswith("a-f-")]
    assert assets
    for event in assets:
        contact = event.find("detail/contact")
        assert contact is not None
        assert contact.get("callsign", "").startswith("REPLAY ")
        assert event.get("uid", "").startswith("pa-console-replay.checkpoint.")
        assert event.get("how") == "m-s"


def _over(seen: Sequence[Element]) -> bool:
    return any("frame.Base.deleted" in event.get("uid", "") for event in seen)


def test_a_server_that_is_not_there_ends_no_replay(call: Call, log: Path) -> None:
    url = f"tcp://{LOOPBACK}:{free_port()}"
    done = call("tak", "--server", url, "--replay", str(log), *SEA, "--speed", "32")
    assert done.code == 0
    assert "it is tried again" in done.err
    assert "0 events sent" in done.err
    assert "not sent" in done.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "give either --join URL for a live session or --replay"),
        (("--join", "mqtt://127.0.0.1", "--replay", "LOG"), "give either --join URL"),
        (("--replay", "nowhere", *SEA), "there is no session"),
        (("--replay", "LOG"), "has no position on the earth"),
        (("--replay", "LOG", "--origin", "north"), "origin north: expected LATITUDE,LONGITUDE"),
        (("--replay", "LOG", "--origin", "91,0"), "origin 91,0: latitude: "),
        (("--replay", "LOG", *SEA, "--name", "a b"), "--name a b: letters, digits"),
        (("--replay", "LOG", *SEA, "--tls-ca", "LOG"), "--tls-cert is missing"),
        (("--replay", "LOG", *SEA, "--world", "nowhere"), "nowhere"),
        (("--join", "mqtt://192.0.2.7"), "pa-console keys make"),
    ],
)
def test_what_is_missing_is_named_with_a_remedy(
    call: Call, log: Path, words: tuple[str, ...], says: str
) -> None:
    given = [str(log) if word == "LOG" else word for word in words]
    done = call("tak", "--server", "tcp://127.0.0.1", *given)
    assert (done.code, done.out) == (2, "")
    assert says in done.err


@pytest.mark.usefixtures("engine")
def test_a_mission_is_shown_while_it_lasts(call: Call, taky: Taky, tmp_path: Path) -> None:
    with taky.client() as client:
        words = ("mission", "Move the drone to the east gate.", "--approve", "auto")
        shown = ("--tak", taky.url, "--tak-origin", "2.0,-30.0", "--log", str(tmp_path / "l.jsonl"))
        done = call("--set", "standing_confidence=0", *words, *shown)
        seen = client.wait(_over)
    assert done.code == 0, done.err
    assert f"TAK map: connected to {taky.url}" in done.err
    assert "warning" not in done.err, "all of it was shown"
    assert "pa-console.checkpoint.Drone_T04" in {event.get("uid", "") for event in seen}


@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize(
    ("option", "seen"), [((), {"ANDROID-1"}), (("--no-tak-contacts",), set[str]())]
)
def test_a_mission_s_log_tells_what_others_report_meanwhile(
    call: Call, taky: Taky, tmp_path: Path, option: tuple[str, ...], seen: set[str]
) -> None:
    file = tmp_path / "l.jsonl"
    over = threading.Event()
    with taky.client() as client:

        def report() -> None:
            while not over.wait(0.02):
                unit = said(site(), "ANDROID-1", "a-h-G-U", (20.0, 5.0), "RED 7")
                client.send(unit.xml())

        reporting = threading.Thread(target=report)
        reporting.start()
        try:
            words = ("mission", "Move the drone to the east gate.", "--approve", "auto")
            shown = ("--tak", taky.url, "--tak-origin", "2.0,-30.0", "--log", str(file), *option)
            done = call("--set", "standing_confidence=0", *words, *shown)
        finally:
            over.set()
            reporting.join()
    assert done.code == 0, done.err
    told = [json.loads(line) for line in file.read_text().splitlines()]
    assert any(line["kind"] == "tak" for line in told)
    reported = [line["data"] for line in told if line["kind"] == "contact_reported"]
    assert {data["contact"]["uid"] for data in reported} == seen
    assert call("replay", "--verify", str(file)).code == 0


def site() -> SiteOnMap:
    """The checkpoint where the sessions are."""
    world = load_world(find_data("worlds", "checkpoint", "world.yaml"))
    return SiteOnMap(world, Geography(Origin(latitude=2.0, longitude=-30.0)), world.name)


@pytest.mark.parametrize(
    ("server", "chosen", "read"),
    [
        ("tcp://127.0.0.1", None, True),
        ("tcp://127.0.0.1", False, False),
        ("tcp://192.0.2.7", None, False),
        ("tcp://192.0.2.7", True, True),
    ],
)
def test_where_anybody_may_invent_them_contacts_are_shown_when_that_is_asked_for(
    server: str, chosen: bool | None, read: bool
) -> None:
    values = Settings(tak=f"{server}:{free_port()}", tak_origin="2.0,-30.0", tak_contacts=chosen)
    with on_map(values, "checkpoint", lambda _: None, lambda _: None) as shown:
        shown.reports.received(said(site(), "ANDROID-1", "a-f-G", (0.0, 0.0)).xml())
        kinds = {data.kind for data in shown.reports.news()}
    assert ("contact_reported" in kinds) == read


@pytest.mark.usefixtures("engine")
def test_a_tak_server_that_is_away_changes_no_mission(call: Call, tmp_path: Path) -> None:
    url = f"tcp://{LOOPBACK}:{free_port()}"
    words = ("mission", "Move the drone to the east gate.", "--approve", "auto")
    shown = ("--tak", url, "--tak-origin", "2.0,-30.0", "--log", str(tmp_path / "l.jsonl"))
    done = call("--set", "standing_confidence=0", *words, *shown)
    assert done.code == 0, done.err
    assert f"\nTAK map: no connection to {url}" in f"\n{done.err}"
    assert f"warning: TAK map: no connection to {url}" in done.err
    nowhere = call(*words, "--tak", url)
    assert (nowhere.code, nowhere.out) == (2, "")
    assert "has no position on the earth" in nowhere.err


def test_without_its_libraries_it_says_what_to_install(
    call: Call, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith("pa_console.tak.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "pa_console.cli.sessions.on_map", raising=False)
    monkeypatch.setitem(sys.modules, "pytak", None)
    done = call("tak", "--server", "tcp://127.0.0.1", "--replay", str(log), *SEA)
    assert done.code == 2
    assert "[tak]'" in done.err
