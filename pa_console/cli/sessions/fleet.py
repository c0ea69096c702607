"""The fleet that `--fleet` names, and the keys that sign for it; a bus is imported only then."""

import hashlib
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

import typer

from pa_console.schema.document import read_bytes
from pa_console.session.log.writer import default_folder
from pa_console.settings.schema import Settings
from pa_console.signing import PASSPHRASE_VARIABLE, SITE_OWNER, SigningError, site_keys
from pa_console.sim.worlds.world_file import open_world
from pa_console.station.clock import Clock, DevicesClock, SteppedClock
from pa_console.terminal.output import errors

if TYPE_CHECKING:
    from pa_console.fleets.station_authority import StationAuthority
    from pa_console.fleets.vda5050.broker import BrokerAddress, Credentials
    from pa_console.fleets.vda5050.joining import JoinedBus
    from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
    from pa_console.station.assembly import Site


STATION, TELEMETRY, JOINED = "station", "telemetry", "joined"
"""The certificates of a station, of its second connection, which only receives, and of a console
that joins its session."""


@dataclass(frozen=True)
class FoundFleet:
    """The world to open, with the robots that joined it on a bus, if one was named."""

    world: str
    joined: "JoinedBus | None" = None
    world_sha256: str = ""
    """The SHA-256 of the file before any robot joined."""

    def drive(self, site: "Site", authority: "StationAuthority | None") -> "MqttFleet | None":
        """Return the fleet of `site` on the bus, None without one; `authority` signs commands.

        Raises ValueError when the bus has another world.
        """
        if self.joined is None:
            return None
        from pa_console.fleets.vda5050.site_fleet import fleet_of  # noqa: PLC0415

        return fleet_of(self.joined, site.world, self.world_sha256, authority)

    def clock(self, own: Clock) -> Clock:
        """Return the clock of the robots on the bus, `own` without one.

        A site that is paced waits for the mission; nobody can hurry any other.
        """
        if self.joined is None:
            return own
        site = self.joined.site
        if site is not None and site.paced:
            return SteppedClock()
        return DevicesClock(site.rate if site is not None else 1.0)


def find_fleet(
    url: str, certificates: Path | None, world: str, settings: Settings, scenario: str | None
) -> FoundFleet:
    """Join the bus at `url`, or none for ""; raises ValueError, or DocumentError for the world.

    A world that robots have joined is kept beside the folder of logs, where a replay finds it.
    """
    if not url:
        return FoundFleet(world)
    from pa_console.fleets.vda5050.broker import BrokerAddress  # noqa: PLC0415
    from pa_console.fleets.vda5050.joining import join, with_newcomers  # noqa: PLC0415
    from pa_console.sim.worlds.world_generator import world_yaml  # noqa: PLC0415

    if scenario:
        raise ValueError("a site plays its own situation: 'pa-console site --scenario NAME'")
    address = BrokerAddress.parse(url)
    loaded, path = open_world(world)
    own, receives = claim_credentials(address, certificates, STATION), None
    if certificates is not None and (certificates / f"{TELEMETRY}.crt").is_file():
        receives = claim_credentials(address, certificates, TELEMETRY)
    joined = join(address, own, receives)
    try:
        sha256 = hashlib.sha256(read_bytes(path)).hexdigest()
        larger, told = with_newcomers(loaded, joined)
        for line in told:
            errors.print_line(line)
        if larger is not loaded:
            world = str(_keep(world_yaml(larger), loaded.name, settings.logs or default_folder()))
    except BaseException:
        joined.link.close()
        raise
    return FoundFleet(world, joined, sha256)


def credentials_of(
    address: "BrokerAddress", certificates: Path | None, name: str
) -> "Credentials | None":
    """Return the certificates of `name`; raises ValueError when they are missing, or in vain."""
    from pa_console.fleets.vda5050.broker import Credentials  # noqa: PLC0415

    folder = _folder(address, certificates)
    return Credentials.of(folder, name) if folder is not None else None


def claim_credentials(
    address: "BrokerAddress", certificates: Path | None, role: str
) -> "Credentials | None":
    """Return certificates of `role` for one connection, until it ends.

    Raises ValueError as `credentials_of` does, and when other programs use all of them.
    """
    from pa_console.fleets.vda5050.broker import Credentials  # noqa: PLC0415

    folder = _folder(address, certificates)
    return Credentials.claim(folder, role) if folder is not None else None


def _folder(address: "BrokerAddress", certificates: Path | None) -> Path | None:
    """Return the folder of certificates, None where the bus has none; raises ValueError."""
    if address.tls and certificates is None:
        raise ValueError(f"{address} needs --certificates FOLDER, of 'pa-console site init FOLDER'")
    if certificates is not None and not address.tls:
        raise ValueError(f"{address} is not encrypted, so --certificates are in vain; use mqtts://")
    return certificates


def _keep(text: str, name: str, logs: Path) -> Path:
    """Write a world where the replay of a log in `logs` looks for it."""
    folder = logs.parent / "worlds"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:12]}.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def load_authority() -> "StationAuthority | None":
    """Return what signs approvals and commands of this machine, None where a site has no keys.

    Raises SigningError for keys that cannot be used, ValueError for a roster that does not hold.
    """
    if not (site_keys() / SITE_OWNER).exists():
        return None
    from pa_console.fleets.key_folder import KeyFolder  # noqa: PLC0415 - where there are keys only
    from pa_console.fleets.station_authority import StationAuthority  # noqa: PLC0415

    folder = KeyFolder(ask=ask_passphrase)
    return StationAuthority(folder.keys(), keep=folder.take)


def ask_passphrase(name: str) -> str:
    """Return the passphrase of a key: that of PA_CONSOLE_PASSPHRASE, or as it is typed."""
    if given := os.environ.get(PASSPHRASE_VARIABLE):
        return given
    if not sys.stdin.isatty():
        raise SigningError(f"the key of {name} has a passphrase: set {PASSPHRASE_VARIABLE}")
    return cast(str, typer.prompt(f"Passphrase of the key of {name}", hide_input=True, err=True))
