"""The access tokens of clients: made, listed and revoked."""

import getpass
import re

from rich.table import Table

from pa_console.fleets.authorization import Trust
from pa_console.http.tokens import TOKENS_FILE, RoleOf, TokenBook, TokenRole
from pa_console.signing import SITE_OWNER, key_path, site_keys
from pa_console.terminal.output import errors, out, print_json


def token_book(trust: Trust | None = None) -> TokenBook:
    """Return the tokens of this machine's user, with the roles in the roster of `trust`.

    By default, `trust` is that of the site whose keys are on this machine, if there is one.
    """
    if trust is None and (site_keys() / SITE_OWNER).exists():
        from pa_console.fleets.key_folder import KeyFolder  # noqa: PLC0415 - only with keys

        trust = KeyFolder().trust()
    return TokenBook(key_path().with_name(TOKENS_FILE), _role_of(trust) if trust else None)


def make(role: TokenRole, person: str | None, *, json: bool = False) -> None:
    """Make a token, and print it; it cannot be shown again."""
    name = person or this_user()
    token = token_book().make(name, role)
    if json:
        print_json({"person": name, "role": role, "token": token})
        return
    errors.print(f"token for {name}, {role}; it is not shown again:")
    out.print_line(token)


def show(*, json: bool = False) -> None:
    """Print the id, person and role of each token; only hashes of tokens are stored."""
    book = token_book()
    rows = book.listed()
    if json:
        print_json({"file": str(book.path), "tokens": [_without_hash(row) for row in rows]})
        return
    table = Table("id", "person", "role", "made")
    for row in rows:
        table.add_row(row.id, row.person, row.role, row.made)
    out.print(table)


def revoke(name: str, *, json: bool = False) -> None:
    """Revoke a token; it is refused from the next request on."""
    token = token_book().revoke(name)
    if json:
        print_json({"revoked": _without_hash(token)})
    else:
        out.print(f"revoked: {token.id}, {token.person}, {token.role}")


def offer_token(tokens: TokenBook, lasting: str) -> None:
    """If no tokens are stored, print a token for this machine's user, without storing it.

    `lasting` names the period for which the token is valid, such as `run`.
    """
    if tokens.listed():
        return
    person = this_user()
    token = tokens.make(person, "operator", keep=False)
    errors.print_line(
        f"no tokens yet; token for {person}, operator, valid for this {lasting} and not shown "
        f"again:\n{token}"
    )


def this_user() -> str:
    """Return the name of this machine's user, with the characters that a token's name may have."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", getpass.getuser()).strip("-_") or "operator"


def _role_of(trust: Trust) -> RoleOf:
    return lambda person: trust.person(person).role


def _without_hash(row: object) -> dict[str, str]:
    return {name: value for name, value in vars(row).items() if name != "sha256"}
