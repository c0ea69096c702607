"""Client ids on the broker of `site init`: each is the name in a certificate, and no other's."""

import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pa_console.fleets.vda5050.additions import SIGNED
from pa_console.fleets.vda5050.broker import BrokerAddress, Credentials
from pa_console.fleets.vda5050.site_files import CONFIGURATION, JOINED, STATION, write_site
from pa_console.fleets.vda5050.station_link import StationLink
from pa_console.schema.world import World
from pa_console.station.joined.shared_log import HEARD
from tests.fleets.broker import free_port, mosquitto, wait_open
from tests.fleets.conftest import joined, running
from tests.fleets.intruder import Intruder

VICTIM, ROBBER = "Drone_T01", "Drone_T02"
UP_S = 10.0


@contextmanager
def site_broker(folder: Path, names: tuple[str, ...]) -> Generator[BrokerAddress | None]:
    """Run Mosquitto on the files of a site; None where Mosquitto is not installed."""
    port = free_port()
    write_site(folder, "yard", names, ("localhost",), port)
    if (program := mosquitto()) is None:
        assert "use_username_as_clientid true" in (folder / CONFIGURATION).read_text()
        yield None
        return
    words = [program, "-c", str(folder / CONFIGURATION)]
    with (
        (folder / "broker.log").open("wb") as log,
        subprocess.Popen(words, stdout=log, stderr=log) as process,
    ):
        try:
            wait_open(port)
            yield BrokerAddress("localhost", port, "yard", tls=True)
        finally:
            process.kill()


def test_a_robot_with_the_client_id_of_another_keeps_nothing_from_it(tmp_path: Path) -> None:
    with site_broker(tmp_path, (VICTIM, ROBBER)) as address:
        if address is None:
            return
        theirs = Credentials.of(tmp_path, ROBBER)
        victim_id = f"yard-{VICTIM}"
        victim = Intruder(address, Credentials.of(tmp_path, VICTIM), victim_id)
        station = Intruder(address, Credentials.of(tmp_path, "station"))
        stop = victim.topic(VICTIM, "instantActions")
        sent = [f"stop {number}".encode() for number in range(30)]
        for payload in sent:
            for client_id in (victim_id, VICTIM):
                Intruder(address, theirs, client_id).close()
            station.send(stop, payload)
        while len(victim.all) < len(sent) and not victim.dropped:
            pass
        assert [payload for _, payload in victim.all] == sent
        assert victim.dropped == 0
        victim.close()
        station.close()


def test_a_site_and_two_consoles_and_the_keys_are_on_the_bus_side_by_side(
    tmp_path: Path, world: World
) -> None:
    """Each connection has a certificate of its own: the broker ends none for another."""
    with site_broker(tmp_path, (*world.assets, *world.cameras)) as address:
        if address is None:
            return

        def let_in(name: str) -> Credentials:
            return Credentials.of(tmp_path, name)

        with (
            running(world, address, credentials=let_in),
            joined(world, address, credentials=Credentials.claim(tmp_path, STATION)) as fleet,
        ):
            others = [
                StationLink(address, "console", HEARD, Credentials.claim(tmp_path, JOINED)),
                StationLink(address, "keys", SIGNED, Credentials.claim(tmp_path, STATION)),
            ]
            assert all(link.wait_connected(UP_S) for link in others)
            while any(asset.comms != "ok" for asset in fleet.picture().assets.values()):
                fleet.step()
            for link in others:
                link.close()
        log = (tmp_path / "broker.log").read_text()
    assert "connected from" in log
    assert "already connected" not in log


def test_a_certificate_is_for_one_program_at_a_time(tmp_path: Path) -> None:
    """A third program is refused before it ends the connection of another."""
    write_site(tmp_path, "yard", (), ("localhost",), 8883)
    first, *others = (Credentials.claim(tmp_path, STATION) for _ in range(3))
    assert first.key.name == "station.key"
    assert [each.key.name for each in others] == ["station-2.key", "station-3.key"]
    with pytest.raises(ValueError, match="site init FOLDER --station NAME"):
        Credentials.claim(tmp_path, STATION)
    assert Credentials.claim(tmp_path, JOINED).key.name == "joined.key"
    first.release()
    assert Credentials.claim(tmp_path, STATION).key.name == "station.key"
    with pytest.raises(ValueError, match="site init"):
        Credentials.claim(tmp_path / "elsewhere", STATION)
