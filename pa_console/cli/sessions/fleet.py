"""The fleet for `--fleet`, and the keys that sign its commands.

The modules of fleets are imported only when they are needed.
"""

import hashlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import time
from typing import TYPE_CHECKING, NamedTuple, cast

import typer

from pa_console.schema.command import DeviceCommand
from pa_console.schema.document import read_bytes
from pa_console.session.log.writer import default_folder
from pa_console.settings.schema import Settings
from pa_console.signing import PASSPHRASE_VARIABLE, SITE_OWNER, SigningError, site_keys
from pa_console.sim.worlds.world_file import open_world
from pa_console.station.clock import Clock, DevicesClock, SteppedClock
from pa_console.terminal.output import errors

if TYPE_CHECKING:
    from pa_console.fleets.link import Link, Listener
    from pa_console.fleets.linked_fleet import LinkedFleet
    from pa_console.fleets.simulated import Verify
    from pa_console.fleets.station_authority import StationAuthority
    from pa_console.fleets.vda5050.broker import BrokerAddress, Credentials
    from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
    from pa_console.fleets.vda5050.station_link import JoinedBus
    from pa_console.schema.world import World
    from pa_console.station.assembly import Site

STATION, TELEMETRY, JOINED = "station", "telemetry", "joined"
"""The roles of certificates: a station, its connection for telemetry, and a joined console."""
FIRST_REPORTS_S = 5.0
"""The longest wait for a report from every asset on a link, in seconds."""


class DrivenFleet(NamedTuple):
    """The fleet of a session, and its part on a message bus; both are None if it is simulated."""

    fleet: "MqttFleet | LinkedFleet | None" = None
    bus: "MqttFleet | None" = None


@dataclass(frozen=True)
class FoundFleet:
    """The world to open, the bus that was joined, and the links to other robots."""

    world: str
    """The world, including the robots that joined on the bus."""
    joined: "JoinedBus | None" = None
    world_sha256: str = ""
    """The SHA-256 of the world file without the robots that joined."""
    links: "tuple[Link, ...]" = ()

    def drive(self, site: "Site", authority: "StationAuthority | None") -> DrivenFleet:
        """Return the fleet of `site` on the bus and the links; `authority` signs commands.

        Raises ValueError if the bus has another world, or if an asset is on two links.
        """
        try:
            bus = self._bus(site, authority)
            if not self.links:
                return DrivenFleet(bus, bus)
            from pa_console.fleets.linked_fleet import LinkedFleet  # noqa: PLC0415

            fleet = LinkedFleet(site.world, self.links, bus)
        except BaseException:
            self.close()
            raise
        if authority is not None:
            fleet.use(authority.authorize, _verify(fleet, authority))
        fleet.wait_for_reports(FIRST_REPORTS_S)
        return DrivenFleet(fleet, bus)

    def _bus(self, site: "Site", authority: "StationAuthority | None") -> "MqttFleet | None":
        if self.joined is None:
            return None
        from pa_console.fleets.vda5050.site_fleet import fleet_of  # noqa: PLC0415

        return fleet_of(self.joined, site.world, self.world_sha256, authority)

    def close(self) -> None:
        """Close the links and the bus if they do not belong to a fleet yet."""
        for link in self.links:
            link.close()
        if self.joined is not None:
            self.joined.link.close()

    def clock(self, own: Clock) -> Clock:
        """Return the clock of the robots, or `own` if there are no robots.

        The station advances the time of a paced site; the time of other robots runs by itself.
        """
        if self.joined is None:
            return DevicesClock() if self.links else own
        site = self.joined.site
        if site is not None and site.paced:
            return SteppedClock()
        return DevicesClock(site.rate if site is not None else 1.0)


def _verify(fleet: "LinkedFleet", authority: "StationAuthority") -> "Verify":
    """Return the verification of tokens for assets on links, which cannot verify them."""
    from pa_console.fleets.station_authority import Vehicles  # noqa: PLC0415 - only with keys

    keys = authority.keys
    vehicles = Vehicles(fleet.world.assets, keys.owner, keys.messages, time)

    def verify(token: str | None, command: DeviceCommand) -> str:
        for message in authority.newest.values():
            vehicles.take(message)
        return vehicles.verify(token, command)

    return verify


def find_fleet(
    urls: Sequence[str],
    certificates: Path | None,
    world: str,
    settings: Settings,
    scenario: str | None,
) -> FoundFleet:
    """Join the bus and open the links at `urls`.

    If robots join, the world that includes them is stored beside the folder of logs, where a replay
    finds it. Raises ValueError, and DocumentError if the world is not valid.
    """
    if not urls:
        return FoundFleet(world)
    from pa_console.fleets.link import open_link  # noqa: PLC0415

    buses = [url for url in urls if _is_bus(url)]
    others = [url for url in urls if url not in buses]
    if len(buses) > 1:
        raise ValueError(f"--fleet accepts at most one message bus, not {' and '.join(buses)}")
    if scenario:
        raise ValueError(
            "--scenario cannot be combined with --fleet; a simulated site can play a situation: "
            "'pa-console site --scenario NAME'"
        )
    if certificates is not None and not buses:
        raise ValueError("--certificates needs a message bus in --fleet")
    fleet = _join_bus(buses[0], certificates, world, settings) if buses else FoundFleet(world)
    links: list[Link] = []
    try:
        if others:
            site = fleet.joined.site if fleet.joined is not None else None
            if site is not None and (site.paced or site.rate != 1.0):
                raise ValueError(
                    f"the site at {buses[0]} has its own clock, which other robots cannot follow; "
                    "run 'pa-console site' without --paced and --rate"
                )
            loaded, _ = open_world(fleet.world)
            links.extend(open_link(url, loaded, settings) for url in others)
    except BaseException:
        replace(fleet, links=tuple(links)).close()
        raise
    return replace(fleet, links=tuple(links))


def open_listener(
    url: str, certificates: Path | None, world: "World", settings: Settings
) -> "Listener":
    """Return the link or the bus at `url`, to survey it; raises ValueError if it cannot be used."""
    if not _is_bus(url):
        from pa_console.fleets.link import open_link  # noqa: PLC0415

        return open_link(url, world, settings)
    from pa_console.fleets.vda5050.examination import BusListener  # noqa: PLC0415

    return BusListener(world, _join(url, certificates))


def _is_bus(url: str) -> bool:
    from pa_console.fleets.link import BUS  # noqa: PLC0415

    return "://" in url and url.partition(":")[0] in BUS


def _join(url: str, certificates: Path | None) -> "JoinedBus":
    """Join the bus at `url`; raises ValueError if it cannot be joined."""
    from pa_console.fleets.vda5050.broker import BrokerAddress  # noqa: PLC0415
    from pa_console.fleets.vda5050.station_link import join  # noqa: PLC0415

    address = BrokerAddress.parse(url)
    own, receives = claim_credentials(address, certificates, STATION), None
    if certificates is not None and (certificates / f"{TELEMETRY}.crt").is_file():
        receives = claim_credentials(address, certificates, TELEMETRY)
    return join(address, own, receives)


def _join_bus(url: str, certificates: Path | None, world: str, settings: Settings) -> FoundFleet:
    """Join the bus at `url`; raises ValueError, and DocumentError if the world is not valid."""
    from pa_console.fleets.vda5050.station_link import with_newcomers  # noqa: PLC0415
    from pa_console.sim.worlds.world_generator import world_yaml  # noqa: PLC0415

    loaded, path = open_world(world)
    joined = _join(url, certificates)
    try:
        sha256 = hashlib.sha256(read_bytes(path)).hexdigest()
        larger, notices = with_newcomers(loaded, joined)
        for line in notices:
            errors.print_line(line)
        if larger is not loaded:
            world = str(_keep(world_yaml(larger), loaded.name, settings.logs or default_folder()))
    except BaseException:
        joined.link.close()
        raise
    return FoundFleet(world, joined, sha256)


def claim_credentials(
    address: "BrokerAddress", certificates: Path | None, role: str
) -> "Credentials | None":
    """Return credentials of `role` for one connection; None if the bus is not encrypted.

    Raises ValueError in the same cases as `certificate_folder`, and if other programs use all of
    the certificates.
    """
    from pa_console.fleets.vda5050.broker import Credentials  # noqa: PLC0415

    folder = certificate_folder(address, certificates)
    return Credentials.claim(folder, role) if folder is not None else None


def certificate_folder(address: "BrokerAddress", certificates: Path | None) -> Path | None:
    """Return the folder of certificates for a bus; None if the bus is not encrypted.

    Raises ValueError if an encrypted bus has no folder, or if an unencrypted bus has one.
    """
    if address.tls and certificates is None:
        raise ValueError(
            f"{address} needs --certificates FOLDER, from 'pa-console site init FOLDER'"
        )
    if certificates is not None and not address.tls:
        raise ValueError(f"--certificates needs an encrypted bus, not {address}; use mqtts://")
    return certificates


def _keep(text: str, name: str, logs: Path) -> Path:
    """Write a world to a file that the replay of a log in `logs` finds; return its path."""
    folder = logs.parent / "worlds"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:12]}.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def load_authority() -> "StationAuthority | None":
    """Return the signer of this machine's approvals and commands; None if there are no site keys.

    Raises SigningError if a key cannot be used, and ValueError if the roster is not valid.
    """
    if not (site_keys() / SITE_OWNER).exists():
        return None
    from pa_console.fleets.key_folder import KeyFolder  # noqa: PLC0415 - only with keys
    from pa_console.fleets.station_authority import StationAuthority  # noqa: PLC0415

    folder = KeyFolder(ask=ask_passphrase)
    return StationAuthority(folder.keys(), keep=folder.take)


def ask_passphrase(name: str) -> str:
    """Return the passphrase of a key, from PA_CONSOLE_PASSPHRASE or typed on the terminal."""
    if given := os.environ.get(PASSPHRASE_VARIABLE):
        return given
    if not sys.stdin.isatty():
        raise SigningError(f"the key of {name} needs a passphrase; set {PASSPHRASE_VARIABLE}")
    return cast(str, typer.prompt(f"Passphrase of the key of {name}", hide_input=True, err=True))
