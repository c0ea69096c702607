"""`pa-console keys sign`: a second person signs a plan on another machine, without a console."""

import json
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from pa_console.cli.keys.site_keys import ask_passphrase
from pa_console.cli.output import errors, print_json
from pa_console.fleets.authorization import Approval, RefusedError, UnsignedApproval
from pa_console.fleets.key_folder import KeyFolder
from pa_console.schema.document import DocumentError, read_bytes
from pa_console.schema.text import visible_line

MOST_BYTES = 131_072


def sign(
    file: Annotated[
        Path, typer.Argument(help="What GET /v1/plans/ID/approval has answered; - for the input.")
    ],
    yes: Annotated[
        bool, typer.Option("--yes", help="Sign without the question, where it was read before.")
    ] = False,
) -> None:
    """Sign a plan that takes two people, with your own key, on a machine without its session.

    It shows what you approve and asks; then it prints the body of POST /v1/plans/ID/signatures.
    """
    unsigned = _read(file)
    approval = unsigned.approval
    folder = KeyFolder(ask=ask_passphrase)
    _show(unsigned, folder)
    if not yes and not _agreed(file):
        raise ValueError("nothing was signed")
    signed = unsigned.signed(folder.person_key(approval.person))
    print_json({"person": approval.person, "signed": signed})


def _read(file: Path) -> UnsignedApproval:
    """Return the text to sign; raises DocumentError or ValueError for any other."""
    name = "standard input" if str(file) == "-" else str(file)
    if str(file) == "-":
        text: bytes = sys.stdin.buffer.read(MOST_BYTES + 1)
    else:
        text = read_bytes(file)
    if len(text) > MOST_BYTES:
        raise DocumentError(name, 0, "", "this is longer than an answer of /v1/plans/ID/approval")
    try:
        answer: Any = json.loads(text)
        if isinstance(answer, dict) and "to_sign" not in answer and "detail" in answer:
            raise DocumentError(name, 0, "", f"the session refused: {answer['detail']}")
        unsigned = UnsignedApproval.read(cast(str, answer["to_sign"]))
    except RefusedError as error:
        raise DocumentError(name, 0, "to_sign", f"{error}; nothing was signed") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DocumentError(
            name, 0, "to_sign", "this is no answer of GET /v1/plans/ID/approval, which has it"
        ) from error
    if unsigned.ends < time.time():
        raise DocumentError(name, 0, "to_sign", "this approval has expired; ask for it again")
    return unsigned


def _show(unsigned: UnsignedApproval, folder: KeyFolder) -> None:
    """Show on stderr the content of the bytes to sign, and no accompanying words."""
    approval: Approval = unsigned.approval
    roster = folder.trust().roster if folder.made else None
    station = roster.station_of(approval.station) if roster is not None else ""
    rules = roster.rules.get(approval.rules) if roster is not None else None
    acts = {"override": "the judge's objection is overridden",
            "acknowledge": "a broken rule of medium priority is accepted"}  # fmt: skip
    until = datetime.fromtimestamp(unsigned.ends, UTC)
    lines = [
        f"{approval.person} approves, at the station "
        f"{station or f'{approval.station[:12]} (not in the roster that is here)'}:",
        *(f"  {order}" for order in approval.orders),
        *(f"  {acts.get(act, act)}" for act in approval.acts),
        f"plan {approval.request}, SHA-256 {approval.plan[:12]}; session {approval.session}",
        f"checked by the rules {rules.name if rules else approval.rules[:12]}",
        f"good until {until:%Y-%m-%d %H:%M:%S} UTC; SHA-256 of what is signed {unsigned.sha256}",
    ]
    for line in lines:
        errors.print(visible_line(line), markup=False, highlight=False, soft_wrap=True)


def _agreed(file: Path) -> bool:
    """Ask on the terminal; raises ValueError where nobody can be asked."""
    if str(file) == "-" or not sys.stdin.isatty():
        raise ValueError("nobody can be asked here; give a file on a terminal, or --yes")
    return typer.confirm("Sign this?", default=False, err=True)
