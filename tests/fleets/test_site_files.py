"""The files of a site: whoever has a certificate is let in, and nobody speaks for another."""

import ssl
import stat
import subprocess
from pathlib import Path

import pytest

from pa_console.fleets.vda5050.broker import NUMBERS, BrokerAddress, Credentials
from pa_console.fleets.vda5050.site_files import ROBOT_READS, ROBOT_WRITES, access, write_site
from tests.fleets.broker import free_port, mosquitto, wait_open
from tests.fleets.intruder import Intruder


def test_files_are_private_and_what_is_there_stays(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    first = write_site(folder, "yard", ("Drone_T01",), ("localhost",), 8883)
    roles = [f"{role}{end}" for role in ("station", "telemetry", "joined") for end in NUMBERS]
    assert first.made == ("broker", *roles, "site", "Drone_T01")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    again = write_site(folder, "yard", ("Drone_T01", "Robot_T03"), ("localhost",), 8883)
    assert again.made == ("Robot_T03",)
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert {name: after[name] for name in before} == before
    for path in folder.iterdir():
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        Credentials.of(folder, "Robot_T03").context()


def test_a_robot_s_topics_are_those_of_its_own_name() -> None:
    lines = [line for line in access("yard").splitlines() if line.startswith("pattern")]
    own = [line for line in lines if "/v3/+/%u/" in line]
    assert len(own) == len(ROBOT_WRITES) + len(ROBOT_READS)
    everybody = [line for line in lines if line not in own]
    trust = "pattern read yard/v3/pa-console/trust"
    assert everybody == [f"{trust}/{name}" for name in ("roster", "revocation", "takeover")]


def test_the_broker_lets_a_robot_speak_for_itself_alone(tmp_path: Path) -> None:
    """Without Mosquitto no broker has certificates; then the rules alone are looked at."""
    port = free_port()
    write_site(tmp_path, "yard", ("Drone_T01", "Drone_T02"), ("localhost",), port)
    address = BrokerAddress("localhost", port, "yard", tls=True)
    if (program := mosquitto()) is None:
        assert "v3/+/%u/state" in access("yard")
        return
    quiet = subprocess.DEVNULL
    words = [program, "-c", str(tmp_path / "mosquitto.conf")]
    with subprocess.Popen(words, stdout=quiet, stderr=quiet) as process:
        try:
            wait_open(port)
            ear = Intruder(address, Credentials.of(tmp_path, "station"))
            drone = Intruder(address, Credentials.of(tmp_path, "Drone_T01"))
            drone.send(drone.topic("Drone_T02", "state"), b"forged")
            drone.send(drone.topic("Drone_T02", "order"), b"forged")
            drone.send(drone.topic("site", "clock"), b"forged")
            drone.send(drone.topic("trust", "takeover"), b"forged")
            ear.send(ear.topic("Drone_T01", "state"), b"forged")
            drone.send(drone.topic("Drone_T01", "state"), b"true")
            while ear.topic("Drone_T01", "state") not in ear.heard:
                pass
            assert [payload for _, payload in ear.all] == [b"true"]
            assert drone.all == []
            ear.send(ear.topic("trust", "takeover"), b"signed")
            while drone.topic("trust", "takeover") not in drone.heard:
                pass
            drone.close()
            ear.close()
            with pytest.raises(ssl.SSLError):
                Intruder(address, None)
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("http://here", "not an address"),
        ("mqtts://", "not an address"),
        ("mqtt://192.0.2.7/vda5050", "only for this machine"),
        ("mqtts://host:99999", "Port"),
        ("mqtts://a:b@host", "only host, port and site"),
        ("mqtts://host/a/b", "name of a site"),
    ],
)
def test_an_address_that_is_none_says_why(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        BrokerAddress.parse(text)


def test_addresses() -> None:
    assert BrokerAddress.parse("mqtts://host") == BrokerAddress("host", 8883, "vda5050", True)
    assert str(BrokerAddress.parse("mqtt://127.0.0.1:1/yard")) == "mqtt://127.0.0.1:1/yard"
