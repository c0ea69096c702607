"""The keys of this machine's site for a session: whoever sits here signs with the own one."""

import os
import sys
from typing import TYPE_CHECKING, cast

import typer

from pa_console.signing import PASSPHRASE_VARIABLE, SITE_OWNER, SigningError, site_keys

if TYPE_CHECKING:
    from pa_console.fleets.station_authority import StationAuthority


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
