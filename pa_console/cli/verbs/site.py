"""`pa-console site`: the simulated checkpoint on a bus, and the files for a site."""

import hashlib
import time
from collections.abc import Callable
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Annotated

import typer
from pydantic import TypeAdapter, ValidationError

from pa_console.cli.options import CertificatesOption, ScenarioOption, SeedOption, WorldOption
from pa_console.cli.sessions.fleet import certificate_folder
from pa_console.end_signals import EndableRun, end_signals, exit_code_of
from pa_console.fleets.key_folder import KeyFolder
from pa_console.fleets.station_authority import Vehicles
from pa_console.fleets.vda5050.broker import (
    INTERFACE,
    PORTS,
    BrokerAddress,
    Credentials,
    run_broker,
)
from pa_console.fleets.vda5050.simulated_site import SimulatedSite, SiteOptions
from pa_console.fleets.vda5050.site_files import RESERVED, Machines, default_hosts, write_site
from pa_console.fleets.vda5050.vehicle import anybody
from pa_console.schema.base import Name
from pa_console.schema.document import read_bytes
from pa_console.schema.text import count, visible
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.sim.worlds.world_file import open_world
from pa_console.terminal.output import errors, out

MOST_MACHINE_NAME = 40
"""The longest name of a machine.

The common name of a certificate, which begins with a role, has at most 64 characters.
"""

app = typer.Typer(
    help="Run the simulated checkpoint on a message bus, or create the files of a site.",
)


@app.callback(invoke_without_command=True)
def site(
    context: typer.Context,
    broker: Annotated[
        str,
        typer.Option("--broker", metavar="URL", help="Address of the broker and the site."),
    ] = f"mqtt://127.0.0.1/{INTERFACE}",
    certificates: CertificatesOption = None,
    embedded_broker: Annotated[
        bool,
        typer.Option(
            "--embedded-broker", help="Also start a broker, for tests on this machine only."
        ),
    ] = False,
    world: WorldOption = "checkpoint",
    scenario: ScenarioOption = None,
    seed: SeedOption = 0,
    rate: Annotated[
        float, typer.Option("--rate", min=0.1, max=100.0, help="Simulated seconds per second.")
    ] = 1.0,
    paced: Annotated[
        bool, typer.Option("--paced", help="Let the station advance the time, for scripts.")
    ] = False,
) -> None:
    """Run the simulated checkpoint, with a VDA 5050 vehicle for each asset, until Ctrl-C."""
    if context.invoked_subcommand is not None:
        return
    address = BrokerAddress.parse(broker)
    if embedded_broker and address.tls:
        raise ValueError(
            "--embedded-broker has no encryption; use it with --broker mqtt://127.0.0.1"
        )
    folder = certificate_folder(address, certificates)

    def let_in(name: str) -> Credentials | None:
        return Credentials.of(folder, name) if folder is not None else None

    let_in("site")  # a site without its own certificate is refused before it starts
    loaded, path = open_world(world)
    played = open_scenario(loaded, path, scenario).scenario if scenario else None
    vehicles = _vehicles(loaded)
    options = SiteOptions(
        world_sha256=hashlib.sha256(read_bytes(path)).hexdigest(),
        scenario=played.name if played is not None else "",
        paced=paced,
        rate=rate,
        verify=vehicles.verify if vehicles is not None else anybody,
        take=_reporting_changes(vehicles) if vehicles is not None else lambda _message: None,
        credentials=let_in,
    )
    checkpoint = Checkpoint(loaded, seed, played)
    endable = EndableRun()
    with end_signals(endable.end), run_broker(address.port) if embedded_broker else nullcontext():
        errors.print_line(
            f"{loaded.title}: {count(len(loaded.assets), 'asset')} at {address}; stop with Ctrl-C"
        )
        endable.run(SimulatedSite(checkpoint, address, options).run())
    if endable.ended_by:
        raise typer.Exit(exit_code_of(endable.ended_by))


@app.command()
def init(
    folder: Annotated[
        Path, typer.Argument(help="Folder to write; existing certificates are kept.")
    ],
    world: WorldOption = "checkpoint",
    robot: Annotated[
        list[str] | None,
        typer.Option(help="Serial number of another robot to certify. Repeatable."),
    ] = None,
    host: Annotated[
        list[str] | None,
        typer.Option(help="Host name or address of the broker. Repeatable."),
    ] = None,
    station: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of another machine that may take command. Repeatable. Its certificates are "
            "written to FOLDER/NAME."
        ),
    ] = None,
    joined: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of another machine that may only join a session. Repeatable. Its "
            "certificates are written to FOLDER/NAME."
        ),
    ] = None,
    name: Annotated[str, typer.Option("--site", help="Name of the site.")] = INTERFACE,
    port: Annotated[
        int, typer.Option("--port", min=1, max=65535, help="Port of the broker.")
    ] = PORTS["mqtts"],
) -> None:
    """Create certificates with their authority, and an access list and settings for Mosquitto."""
    loaded, _ = open_world(world)
    for serial in robot or ():
        _check_name("--robot", serial)
        if serial in RESERVED:
            raise ValueError(f"--robot {serial}: this name is reserved; choose another")
    machines = Machines(tuple(station or ()), tuple(joined or ()))
    for machine in machines.stations:
        _check_name("--station", machine, MOST_MACHINE_NAME)
    for machine in machines.joined:
        _check_name("--joined", machine, MOST_MACHINE_NAME)
    robots = tuple(dict.fromkeys((*loaded.assets, *loaded.cameras, *(robot or ()))))
    address = BrokerAddress.parse(f"mqtts://localhost:{port}/{name}")
    hosts = (*default_hosts(), *(host or ()))
    written = write_site(
        folder, address.site, robots, tuple(dict.fromkeys(hosts)), port, machines=machines
    )
    made, kept = count(len(written.made), "certificate"), len(written.kept)
    out.print_line(
        f"{written.folder}: {made} made{f', {kept} kept' if kept else ''}\n"
        f"broker:  mosquitto -c {written.folder}/mosquitto.conf\n"
        f"site:    pa-console site --broker {address} --certificates {folder}\n"
        f"station: pa-console console --fleet {address} --certificates {folder}"
    )


def _vehicles(world: World) -> Vehicles | None:
    """Return the verification of commands by the vehicles; None if there are no site keys here.

    It uses wall time, like the station that signs, regardless of the speed of the site.
    """
    folder = KeyFolder()
    if not folder.made:
        return None
    return Vehicles(world.assets, folder.owner, folder.messages, time.time)


def _reporting_changes(vehicles: Vehicles) -> Callable[[str], None]:
    """Return a callback that passes signed messages to `vehicles`, and reports changes."""
    reported = vehicles.in_command

    def take(message: str) -> None:
        nonlocal reported
        why = vehicles.take(message)
        line = f"ignored a signed message: {why}" if why else vehicles.in_command
        if line != reported:
            reported = line
            errors.print_line(visible(line))

    return take


def _check_name(option: str, name: str, most: int = 64) -> None:
    """Raise ValueError if `name` is not a valid name of an asset or a machine."""
    with suppress(ValidationError):
        if len(TypeAdapter[str](Name).validate_python(name)) <= most:
            return
    raise ValueError(
        f"{option} {name}: give at most {most} letters, digits and _, beginning with a letter, "
        "such as Robot_T03"
    )
