"""What the owner of a site signs reaches the other machines of the site over its bus."""

from pathlib import Path

import pytest

from pa_console.cli.verbs.keys import on_bus
from pa_console.fleets.authorization import EnrolledRules
from pa_console.fleets.key_folder import KeyFolder
from pa_console.fleets.vda5050.broker import BrokerAddress
from tests.fleets.broker import free_port
from tests.fleets.keyring import RULES


def test_a_machine_that_joins_learns_the_roster_and_who_commands(
    address: BrokerAddress, tmp_path: Path
) -> None:
    url = str(address)
    owner, other = KeyFolder(tmp_path / "owner"), KeyFolder(tmp_path / "other")
    owner.make_site("ann", "north", {RULES: EnrolledRules("two", {"block": 2})})
    person, station = other.join("bob", "south", owner.owner)
    with on_bus(owner, url, None):
        owner.enrol_person("bob", person, "operator")
        owner.enrol_station("south", station)
    with on_bus(other, url, None):
        assert other.trust().roster == owner.trust().roster, "taken before anything is done"
        assert other.person()[0] == "bob"
    with on_bus(owner, url, None):
        owner.take_over("south")
        owner.revoke("bob")
    with on_bus(other, url, None):
        found = other.trust()
        assert "south is in command since epoch 2" in found.in_command
        assert (found.roster.people.keys(), found.revoked) == ({"ann"}, {person})


def test_without_a_broker_nothing_is_signed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pa_console.cli.verbs.keys.CONNECT_S", 0.2)
    folder = KeyFolder(tmp_path / "keys")
    folder.make_site("ann", "north", {RULES: EnrolledRules("two")})
    before = folder.newest
    with (
        pytest.raises(ValueError, match="cannot connect to the broker"),
        on_bus(folder, f"mqtt://127.0.0.1:{free_port()}", None),
    ):
        folder.revoke("ann")
    assert folder.newest == before
