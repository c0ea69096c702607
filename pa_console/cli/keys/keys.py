"""`pa-console keys`: the keys with which people approve, stations command, and vehicles check."""

import getpass
import os
import platform
import re
from enum import Enum
from typing import Annotated, cast

import typer
from rich.table import Table

from pa_console.cli.keys.on_the_bus import on_bus
from pa_console.cli.keys.signing import sign
from pa_console.cli.keys.site_keys import ask_passphrase
from pa_console.cli.output import CertificatesOption, JsonOption, errors, out, print_json
from pa_console.fleets.authorization import EnrolledRules
from pa_console.fleets.key_folder import KeyFolder
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.rule import approvals_in_words
from pa_console.signing import PASSPHRASE_VARIABLE, fingerprint, is_public_key
from pa_console.station.assembly import open_rules

app = typer.Typer(
    help="Make, list, enrol, revoke and rotate the keys of a site; sign; put a station in command.",
    no_args_is_help=True,
)


class RoleOption(Enum):
    """The role of a person."""

    observer = "observer"
    operator = "operator"
    commander = "commander"


class Enrolled(Enum):
    """The kinds of roster entries."""

    person = "person"
    station = "station"
    rules = "rules"


def _new_passphrase(*, wanted: bool) -> str:
    if not wanted:
        return ""
    if given := os.environ.get(PASSPHRASE_VARIABLE):
        return given
    asked = typer.prompt("New passphrase", hide_input=True, confirmation_prompt=True, err=True)
    return cast(str, asked)


PassphraseOption = Annotated[
    bool, typer.Option("--passphrase", help="Protect the new key with a passphrase.")
]


BusOption = Annotated[
    str,
    typer.Option("--fleet", metavar="URL", help="Tell vehicles and stations on this bus at once."),
]


@app.command()
def make(
    name: Annotated[
        str | None, typer.Argument(help="Whose key; default: the user of this machine.")
    ] = None,
    role: Annotated[
        RoleOption, typer.Option(help="The role of one more person of a site; the owner gives it.")
    ] = RoleOption.operator,
    station: Annotated[
        str | None, typer.Option(help="The name of this station; default: that of the machine.")
    ] = None,
    join: Annotated[
        str | None,
        typer.Option(metavar="KEY", help="Join the site of this owner's key; it has to enrol you."),
    ] = None,
    passphrase: PassphraseOption = False,
) -> None:
    """Make the keys of a new site, of one more person of it, or of a station that joins one.

    A new site has an owner, this station, which is in command, and one commander.
    """
    folder = KeyFolder(ask=ask_passphrase)
    person = name or _plain(getpass.getuser())
    its = station or _plain(platform.node().partition(".")[0])
    if join is not None:
        own, other = folder.join(person, its, _public(join), _new_passphrase(wanted=passphrase))
        out.print("The owner of the site has to enrol both:", markup=False)
        enrol = f"pa-console keys enrol person {person} {own} --role {role.value}"
        out.print(enrol, markup=False, soft_wrap=True)
        out.print(f"pa-console keys enrol station {its} {other}", markup=False, soft_wrap=True)
        return
    if folder.made:
        if name is None:
            raise ValueError(f"{folder.path}: there are keys already; see pa-console keys list")
        folder.make_person(person, role.value, _new_passphrase(wanted=passphrase))
        _show(folder)
        return
    rules = _enrolled(open_rules("checkpoint")[0])
    folder.make_site(person, its, dict((rules,)), _new_passphrase(wanted=passphrase))
    out.print(f"keys: {folder.path}", markup=False, soft_wrap=True)
    _show(folder)


@app.command("list")
def list_keys(
    fleet: BusOption = "", certificates: CertificatesOption = None, json: JsonOption = False
) -> None:
    """List people, stations and rule sets of the site, the station in command, and revoked keys.

    With --fleet, newer messages on the bus are taken from there first.
    """
    folder = KeyFolder()
    with on_bus(folder, fleet, certificates):
        pass
    _show(folder, json=json)


@app.command()
def enrol(
    kind: Annotated[Enrolled, typer.Argument(help="What is enrolled.")],
    name: Annotated[str, typer.Argument(help="A person, a station, or a rule file.")],
    key: Annotated[
        str | None, typer.Argument(help="The public key of a person or station.")
    ] = None,
    role: Annotated[RoleOption, typer.Option(help="The role of a person.")] = RoleOption.operator,
    fleet: BusOption = "",
    certificates: CertificatesOption = None,
) -> None:
    """Take a person, a station or a rule set into the roster, which the owner's key signs.

    Of rule sets of one name vehicles take the one that was enrolled last.
    """
    folder = KeyFolder(ask=ask_passphrase)
    if key is None and kind is not Enrolled.rules:
        raise ValueError(f"give the public key of the {kind.value}, which 'keys make' has printed")
    with on_bus(folder, fleet, certificates):
        if key is None:
            folder.enrol_rules(*_enrolled(open_rules(name)[0]))
        elif kind is Enrolled.person:
            folder.enrol_person(name, _public(key), role.value)
        else:
            folder.enrol_station(name, _public(key))
    _show(folder)


@app.command()
def revoke(
    name: Annotated[str, typer.Argument(help="A person or a station.")],
    fleet: BusOption = "",
    certificates: CertificatesOption = None,
) -> None:
    """Revoke the key of a person or station for ever."""
    folder = KeyFolder(ask=ask_passphrase)
    with on_bus(folder, fleet, certificates):
        folder.revoke(name)
    _show(folder)


@app.command()
def rotate(
    name: Annotated[str, typer.Argument(help="A person or a station with a key on this machine.")],
    passphrase: PassphraseOption = False,
    fleet: BusOption = "",
    certificates: CertificatesOption = None,
) -> None:
    """Make a new key for a person or station, and revoke the one before."""
    folder = KeyFolder(ask=ask_passphrase)
    with on_bus(folder, fleet, certificates):
        folder.rotate(name, _new_passphrase(wanted=passphrase))
    _show(folder)


@app.command()
def takeover(
    station: Annotated[str, typer.Argument(help="The station that is in command from now on.")],
    fleet: BusOption = "",
    certificates: CertificatesOption = None,
) -> None:
    """Put a station in command; a commander's key signs the next epoch.

    Vehicles that have heard of it take nothing of the station before.
    """
    folder = KeyFolder(ask=ask_passphrase)
    with on_bus(folder, fleet, certificates):
        folder.take_over(station)
    _show(folder)


app.command()(sign)


def _show(folder: KeyFolder, *, json: bool = False) -> None:
    trust, rows = folder.trust(), folder.listed()
    roster = trust.roster
    if json:
        print_json(
            {
                "folder": str(folder.path),
                "roster": roster.serial,
                "revocation": trust.revocation,
                "epoch": trust.takeover.epoch,
                "keys": [vars(row) for row in rows],
                "rules": {sha: vars(its) for sha, its in roster.rules.items()},
            }
        )
        return
    table = Table("kind", "name", "role", "state", "here", "key")
    for row in rows:
        here = "yes" if row.here else "no"
        table.add_row(row.kind, row.name, row.role, row.state, here, fingerprint(row.key))
    out.print(table)
    for sha, its in roster.rules.items():
        asked = approvals_in_words(its.approvals)
        more = f"; people who must approve: {asked}" if asked else ""
        out.print(f"rules {its.name} {sha[:12]}{more}", markup=False, soft_wrap=True)
    out.print(f"roster {roster.serial}; {trust.in_command}", markup=False, soft_wrap=True)
    if trust.takeover.station in trust.revoked:
        told = "no vehicle moves until another station is in command: pa-console keys takeover NAME"
        errors.print(told, style="bold red", markup=False)


def _enrolled(book: Rulebook) -> tuple[str, EnrolledRules]:
    return book.seal.content_sha256, EnrolledRules(book.name, dict(book.approvals))


def _plain(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-_") or "station"


def _public(key: str) -> str:
    if not is_public_key(key):
        raise ValueError(f"{key!r} is no public key: 64 hexadecimal digits")
    return key
