"""Bearer tokens and their roles; of a stored token, only the hash is kept."""

import hashlib
import json
import re
import secrets
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from pa_console.fleets.authorization import RefusedError, Role
from pa_console.private_files import make_private_folder, read_private, replace_private

PREFIX = "pa_"
TOKENS_FILE = "serve-tokens.json"
MOST_TOKENS = 256
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")

TokenRole = Literal["observer", "proposer", "operator", "commander"]
"""The roles in rising order, each with the rights of those before it; a proposer is a program."""
TOKEN_ROLES: tuple[TokenRole, ...] = ("observer", "proposer", "operator", "commander")

RoleOf = Callable[[str], Role]
"""A function that returns a person's role in the roster; raises RefusedError if there is none."""


@dataclass(frozen=True)
class Bearer:
    """The owner of a token, a person or program, with a role."""

    person: str
    role: TokenRole

    def may(self, role: TokenRole) -> bool:
        """Return whether this bearer has the rights of `role`."""
        return TOKEN_ROLES.index(self.role) >= TOKEN_ROLES.index(role)


@dataclass(frozen=True)
class KeptToken:
    """One stored token, of which only the hash `sha256` is kept."""

    id: str
    person: str
    role: TokenRole
    sha256: str
    made: str


class TokenBook:
    """The tokens of this machine's user, stored in a private file, and those of one session.

    A token has 256 random bits, so its plain hash does not reveal it. The file is read again when
    it has changed, so a revoked token is refused from the next request on.
    """

    def __init__(self, path: Path, role_of: RoleOf | None = None) -> None:
        """Limit each role to the one that `role_of` returns; None if there is no roster."""
        self.path, self._role_of = path, role_of
        self._own: dict[str, Bearer] = {}
        self._kept: dict[str, KeptToken] = {}
        self._seen: tuple[int, int] | None = None

    def find(self, token: str) -> Bearer | None:
        """Return the bearer of `token`; None if the token is unknown.

        Raises RefusedError for a person whom the roster does not admit, ValueError or OSError for a
        file that cannot be used.
        """
        digest = _hash(token)
        bearer = self._own.get(digest)
        if bearer is None:
            self._read_changed()
            kept = self._kept.get(digest)
            if kept is None:
                return None
            bearer = Bearer(kept.person, kept.role)
        return self._limited(bearer)

    def make(self, person: str, role: TokenRole, *, keep: bool = True) -> str:
        """Return a new token, which is shown once.

        With `keep`, its hash is stored; otherwise the token is valid in this session only. Raises
        ValueError for an invalid name, and if the roster does not admit that person with that role.
        """
        if _NAME.fullmatch(person) is None:
            raise ValueError(f"{person!r} is not a name: letters, digits, - and _, at most 64")
        try:
            limited = self._limited(Bearer(person, role))
        except RefusedError as error:
            raise ValueError(str(error)) from error
        if limited.role != role:
            raise ValueError(f"{person} has another role in the roster than {role}")
        token = PREFIX + secrets.token_urlsafe(32)
        if not keep:
            self._own[_hash(token)] = Bearer(person, role)
            return token
        self._read_changed()
        if len(self._kept) >= MOST_TOKENS:
            raise ValueError(f"{self.path}: {MOST_TOKENS} tokens are stored already; revoke some")
        made = datetime.now(UTC).isoformat(timespec="seconds")
        one = KeptToken(secrets.token_hex(4), person, role, _hash(token), made)
        self._write([*self._kept.values(), one])
        return token

    def revoke(self, name: str) -> KeptToken:
        """Delete the token with the id `name`; raises ValueError if there is none."""
        self._read_changed()
        kept = [one for one in self._kept.values() if one.id == name]
        if not kept:
            ids = ", ".join(one.id for one in self._kept.values()) or "none"
            raise ValueError(f"there is no token {name!r}; known: {ids}")
        self._write([one for one in self._kept.values() if one.id != name])
        return kept[0]

    def listed(self) -> list[KeptToken]:
        """Return the stored tokens, oldest first."""
        self._read_changed()
        return list(self._kept.values())

    def _limited(self, bearer: Bearer) -> Bearer:
        """Return the bearer with at most the role in the roster; raises RefusedError without one.

        A program that proposes is not a person, so it is not in the roster.
        """
        if self._role_of is None or bearer.role == "proposer":
            return bearer
        allowed = self._role_of(bearer.person)
        least = min(TOKEN_ROLES.index(bearer.role), TOKEN_ROLES.index(allowed))
        return Bearer(bearer.person, TOKEN_ROLES[least])

    def _read_changed(self) -> None:
        try:
            stat = self.path.stat()
        except FileNotFoundError:
            self._kept, self._seen = {}, None
            return
        seen = stat.st_mtime_ns, stat.st_ino
        if seen == self._seen:
            return
        try:
            listed = json.loads(read_private(self.path))
            kept = [KeptToken(**one) for one in listed]
            if any(one.role not in TOKEN_ROLES for one in kept):
                raise ValueError("it has an unknown role")
        except (TypeError, ValueError) as error:
            self._kept, self._seen = {}, None
            raise ValueError(
                f"{self.path}: not a list of tokens ({error}); move it away and make new ones"
            ) from error
        self._kept, self._seen = {one.sha256: one for one in kept}, seen

    def _write(self, tokens: list[KeptToken]) -> None:
        make_private_folder(self.path.parent)
        text = json.dumps([asdict(one) for one in tokens], indent=1)
        replace_private(self.path, text.encode())
        self._seen = None
        self._read_changed()


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()


__all__ = ["Bearer", "KeptToken", "RefusedError", "RoleOf", "TokenBook", "TokenRole"]
