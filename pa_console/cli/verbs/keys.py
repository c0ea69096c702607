"""`pa-console keys`: the keys of a site, with which people, stations and its owner sign."""

import getpass
import json
import os
import platform
import re
import secrets
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.table import Table

from pa_console.cli.options import CertificatesOption, JsonOption
from pa_console.cli.sessions.fleet import STATION, ask_passphrase, claim_credentials
from pa_console.fleets.authorization import (
    Approval,
    EnrolledRules,
    RefusedError,
    SignedMessages,
    UnsignedApproval,
)
from pa_console.fleets.key_folder import KeyFolder
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.document import DocumentError, read_bytes
from pa_console.schema.rule import approvals_in_words
from pa_console.schema.text import visible_line
from pa_console.signing import PASSPHRASE_VARIABLE, fingerprint, is_public_key
from pa_console.station.assembly import open_rules
from pa_console.terminal.output import errors, out, print_json

CONNECT_S = 5.0
MOST_BYTES = 131_072
"""The largest accepted file with an approval, in bytes."""
ACTS = {
    "override": "the judge's objection is overridden",
    "acknowledge": "a broken rule of medium priority is accepted",
}

app = typer.Typer(
    help="Manage the keys of a site, sign approvals, and put a station in command.",
    no_args_is_help=True,
)


class RoleOption(Enum):
    """The role of a person."""

    observer = "observer"
    operator = "operator"
    commander = "commander"


class RosterEntryKind(Enum):
    """The kinds of roster entries."""

    person = "person"
    station = "station"
    rules = "rules"


PassphraseOption = Annotated[
    bool, typer.Option("--passphrase", help="Protect the new key with a passphrase.")
]
BusOption = Annotated[
    str,
    typer.Option("--fleet", metavar="URL", help="Publish to vehicles and stations on this bus."),
]


@app.command()
def make(
    name: Annotated[
        str | None, typer.Argument(help="Person that the key is for. Default: the current user.")
    ] = None,
    role: Annotated[
        RoleOption, typer.Option(help="Role of a person who is added to a site.")
    ] = RoleOption.operator,
    station: Annotated[
        str | None, typer.Option(help="Name of this station. Default: the name of this machine.")
    ] = None,
    join: Annotated[
        str | None,
        typer.Option(
            metavar="KEY", help="Join the site whose owner has this key; the owner enrols you."
        ),
    ] = None,
    passphrase: PassphraseOption = False,
) -> None:
    """Make the keys of a new site, of another person, or of a station that joins a site.

    A new site has an owner, one commander, and this station, which is in command.
    """
    folder = KeyFolder(ask=ask_passphrase)
    person = name or _plain(getpass.getuser())
    own_station = station or _plain(platform.node().partition(".")[0])
    if join is not None:
        own, other = folder.join(
            person, own_station, _public(join), _new_passphrase(wanted=passphrase)
        )
        out.print("Ask the owner of the site to enrol both keys:")
        enrol = f"pa-console keys enrol person {person} {own} --role {role.value}"
        out.print_line(enrol)
        out.print_line(f"pa-console keys enrol station {own_station} {other}")
        return
    if folder.made:
        if name is None:
            raise ValueError(
                f"{folder.path}: there are keys already; list them with 'pa-console keys list'"
            )
        folder.make_person(person, role.value, _new_passphrase(wanted=passphrase))
        _show(folder)
        return
    rules = _enrolled(open_rules("checkpoint")[0])
    folder.make_site(person, own_station, dict((rules,)), _new_passphrase(wanted=passphrase))
    out.print_line(f"keys: {folder.path}")
    _show(folder)


@app.command("list")
def list_keys(
    fleet: BusOption = "", certificates: CertificatesOption = None, json: JsonOption = False
) -> None:
    """List people, stations and rule sets of the site, the station in command, and revoked keys.

    With --fleet, newer messages are fetched from the bus first.
    """
    folder = KeyFolder()
    with on_bus(folder, fleet, certificates):
        pass
    _show(folder, json=json)


@app.command()
def enrol(
    kind: Annotated[RosterEntryKind, typer.Argument(help="Kind of entry.")],
    name: Annotated[str, typer.Argument(help="Person, station or rule file.")],
    key: Annotated[str | None, typer.Argument(help="Public key of the person or station.")] = None,
    role: Annotated[RoleOption, typer.Option(help="Role of the person.")] = RoleOption.operator,
    fleet: BusOption = "",
    certificates: CertificatesOption = None,
) -> None:
    """Add a person, a station or a rule set to the roster, and sign it with the owner's key.

    If several rule sets have the same name, vehicles use the one that was enrolled last.
    """
    if key is None and kind is not RosterEntryKind.rules:
        raise ValueError(
            f"give the public key of the {kind.value}, which 'pa-console keys make' prints"
        )
    with _changing(fleet, certificates) as folder:
        if key is None:
            folder.enrol_rules(*_enrolled(open_rules(name)[0]))
        elif kind is RosterEntryKind.person:
            folder.enrol_person(name, _public(key), role.value)
        else:
            folder.enrol_station(name, _public(key))


@app.command()
def revoke(
    name: Annotated[str, typer.Argument(help="Person or station.")],
    fleet: BusOption = "",
    certificates: CertificatesOption = None,
) -> None:
    """Revoke the key of a person or a station permanently."""
    with _changing(fleet, certificates) as folder:
        folder.revoke(name)


@app.command()
def rotate(
    name: Annotated[str, typer.Argument(help="Person or station with a key on this machine.")],
    passphrase: PassphraseOption = False,
    fleet: BusOption = "",
    certificates: CertificatesOption = None,
) -> None:
    """Replace the key of a person or a station, and revoke the old key."""
    with _changing(fleet, certificates) as folder:
        folder.rotate(name, _new_passphrase(wanted=passphrase))


@app.command()
def takeover(
    station: Annotated[str, typer.Argument(help="Station to put in command.")],
    fleet: BusOption = "",
    certificates: CertificatesOption = None,
) -> None:
    """Put a station in command, signed with the key of a commander.

    Vehicles that receive the change accept no more commands from the previous station.
    """
    with _changing(fleet, certificates) as folder:
        folder.take_over(station)


@contextmanager
def _changing(url: str, certificates: Path | None) -> Generator[KeyFolder]:
    """Yield this machine's keys for a change; then publish it at `url`, and show the keys."""
    folder = KeyFolder(ask=ask_passphrase)
    with on_bus(folder, url, certificates):
        yield folder
    _show(folder)


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
                "rules": {sha: vars(rule_set) for sha, rule_set in roster.rules.items()},
            }
        )
        return
    table = Table("kind", "name", "role", "state", "here", "key")
    for row in rows:
        here = "yes" if row.here else "no"
        table.add_row(row.kind, row.name, row.role, row.state, here, fingerprint(row.key))
    out.print(table)
    for sha, rule_set in roster.rules.items():
        required = approvals_in_words(rule_set.approvals)
        more = f"; required approvals: {required}" if required else ""
        out.print_line(f"rules {rule_set.name} {sha[:12]}{more}")
    out.print_line(f"roster {roster.serial}; {trust.in_command}")
    if trust.takeover.station in trust.revoked:
        errors.print(
            "no vehicle moves until another station is in command: pa-console keys takeover NAME",
            style="bold red",
        )


def _new_passphrase(*, wanted: bool) -> str:
    if not wanted:
        return ""
    if given := os.environ.get(PASSPHRASE_VARIABLE):
        return given
    typed = typer.prompt("New passphrase", hide_input=True, confirmation_prompt=True, err=True)
    return cast(str, typed)


def _enrolled(book: Rulebook) -> tuple[str, EnrolledRules]:
    return book.seal.content_sha256, EnrolledRules(book.name, dict(book.approvals))


def _plain(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-_") or "station"


def _public(key: str) -> str:
    if not is_public_key(key):
        raise ValueError(f"{key!r} is not a public key, which has 64 hexadecimal digits")
    return key


@contextmanager
def on_bus(folder: KeyFolder, url: str, certificates: Path | None) -> Generator[None]:
    """Store newer messages from the bus at `url` in `folder`; afterwards, publish the newest there.

    Does nothing without a `url`. Raises ValueError if there is no connection to the broker.
    """
    if not url:
        yield
        return
    from pa_console.fleets.vda5050.additions import SIGNED, TRUST, SignedMessage  # noqa: PLC0415
    from pa_console.fleets.vda5050.broker import BrokerAddress  # noqa: PLC0415 - only with a bus
    from pa_console.fleets.vda5050.sharing import signed_messages  # noqa: PLC0415
    from pa_console.fleets.vda5050.station_link import StationLink, take_retained  # noqa: PLC0415
    from pa_console.fleets.vda5050.wire import Numbers  # noqa: PLC0415

    address = BrokerAddress.parse(url)
    name = f"keys-{secrets.token_hex(4)}"
    link = StationLink(address, name, SIGNED, claim_credentials(address, certificates, STATION))
    try:
        if not link.wait_connected(CONNECT_S):
            raise ValueError(f"cannot connect to the broker at {address}: {link.problem}")
        messages = SignedMessages(folder.take)
        for delivery in take_retained(link):
            if isinstance(delivery.message, SignedMessage) and delivery.topic.identity == TRUST:
                messages.hear(delivery.message.message)
        yield
        newest = folder.newest
        link.publish(*signed_messages(address.site, newest, Numbers(), datetime.now(UTC)))
    finally:
        link.close()
    errors.print_line(f"published at {address}: {', '.join(newest)}")


@app.command()
def sign(
    file: Annotated[
        Path, typer.Argument(help="File with the answer of GET /v1/plans/ID/approval; - for stdin.")
    ],
    yes: Annotated[bool, typer.Option("--yes", help="Sign without asking.")] = False,
) -> None:
    """Countersign a plan with your own key, on a machine that does not run its session.

    The verb shows the plan, asks you, and prints the body for POST /v1/plans/ID/signatures.
    """
    unsigned = _read_approval(file)
    approval = unsigned.approval
    folder = KeyFolder(ask=ask_passphrase)
    _show_approval(unsigned, folder)
    if not yes and not _agreed(file):
        raise ValueError("nothing was signed")
    signed = unsigned.signed(folder.person_key(approval.person))
    print_json({"person": approval.person, "signed": signed})


def _read_approval(file: Path) -> UnsignedApproval:
    """Return the approval to sign from `file`; DocumentError or ValueError if there is none."""
    name = "standard input" if str(file) == "-" else str(file)
    if str(file) == "-":
        text: bytes = sys.stdin.buffer.read(MOST_BYTES + 1)
    else:
        text = read_bytes(file)
    if len(text) > MOST_BYTES:
        raise DocumentError(name, 0, "", "too long for an answer of GET /v1/plans/ID/approval")
    try:
        answer: Any = json.loads(text)
        if isinstance(answer, dict) and "to_sign" not in answer and "detail" in answer:
            raise DocumentError(name, 0, "", f"the session refused: {answer['detail']}")
        unsigned = UnsignedApproval.read(cast(str, answer["to_sign"]))
    except RefusedError as error:
        raise DocumentError(name, 0, "to_sign", f"{error}; nothing was signed") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DocumentError(
            name, 0, "to_sign", "missing or invalid; give the answer of GET /v1/plans/ID/approval"
        ) from error
    if unsigned.ends < time.time():
        raise DocumentError(name, 0, "to_sign", "this approval has expired; request it again")
    return unsigned


def _show_approval(unsigned: UnsignedApproval, folder: KeyFolder) -> None:
    """Print the content of the bytes to sign on stderr, but no other part of the file."""
    approval: Approval = unsigned.approval
    roster = folder.trust().roster if folder.made else None
    station = roster.station_of(approval.station) if roster is not None else ""
    rules = roster.rules.get(approval.rules) if roster is not None else None
    until = datetime.fromtimestamp(unsigned.ends, UTC)
    lines = [
        f"{approval.person} approves, at the station "
        f"{station or f'{approval.station[:12]} (not in the roster of this machine)'}:",
        *(f"  {order}" for order in approval.orders),
        *(f"  {ACTS.get(act, act)}" for act in approval.acts),
        f"plan {approval.request}, SHA-256 {approval.plan[:12]}; session {approval.session}",
        f"checked by the rules {rules.name if rules else approval.rules[:12]}",
        f"valid until {until:%Y-%m-%d %H:%M:%S} UTC; SHA-256 of the signed text {unsigned.sha256}",
    ]
    for line in lines:
        errors.print_line(visible_line(line))


def _agreed(file: Path) -> bool:
    """Ask on the terminal whether to sign, and return the answer; ValueError without a terminal."""
    if str(file) == "-" or not sys.stdin.isatty():
        raise ValueError(
            "signing needs a confirmation; give a file and run this on a terminal, or use --yes"
        )
    return typer.confirm("Sign this?", default=False, err=True)
