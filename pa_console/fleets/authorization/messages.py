"""The signed messages of a site: approvals, tokens, rosters, revocations, takeovers, records.

Each message is a JWT, signed with Ed25519 ("EdDSA"). Its header names the kind of message.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import lru_cache
from typing import Any, Literal, Protocol, Self, TypeGuard, cast

import jwt
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from jwt.utils import base64url_decode, base64url_encode

Role = Literal["observer", "operator", "commander"]
ROLES: tuple[Role, ...] = ("observer", "operator", "commander")
"""The roles of people, in ascending order of rights.

Observers watch, operators also approve, and commanders also put stations in command.
"""

Kind = Literal["operator", "override", "standing"]
KINDS: tuple[Kind, ...] = ("operator", "override", "standing")
"""The kinds of approval.

An `operator` approval is given with the plan in view, an `override` goes against the judge's
Failure and gives a reason, and a `standing` approval is given in advance.
"""

Message = Literal["command", "approval", "roster", "revocation", "takeover", "records"]
UNSIGNED = frozenset(("hold",))
"""The commands that never need a token, so that a stop always gets through."""

TOKEN_S = 30.0
"""The longest validity of a token, in seconds. A command that is sent again gets a new token."""

APPROVAL_S = 3600.0
"""The longest validity of an approval of a plan and its way to safety, in seconds."""

RECORDS_S = 10.0
"""The longest validity of the signature on shared records of a session log, in seconds."""

LEEWAY_S = 2.0
"""The largest accepted difference between the clocks of a station and a vehicle, in seconds."""

MOST_USED = 4096
"""The largest number of used tokens that a vehicle remembers. Older tokens are refused."""

MOST_CHARACTERS = 65_536
"""The largest accepted length of a message."""

ROUNDING_S = 0.001
"""The tolerance for rounding errors in a period of validity, in seconds."""

_ALGORITHM = "EdDSA"
_APPROVAL_HEADER = {"alg": "EdDSA", "typ": "pa-approval+jwt"}
_OF_GROUNDS = ("session", "plan", "rules", "kind", "epoch")
_TEXTS = ("person", "station", "session", "request", "plan", "rules")
_JWS = jwt.PyJWS(algorithms=[_ALGORITHM])
Claims = dict[str, Any]


class Command(Protocol):
    """A command as a vehicle receives it. `target` is None if the command takes no frame."""

    @property
    def command_id(self) -> str: ...  # noqa: D102
    @property
    def agent(self) -> str: ...  # noqa: D102
    @property
    def verb(self) -> str: ...  # noqa: D102
    @property
    def target(self) -> str | None: ...  # noqa: D102


@dataclass(frozen=True)
class Person:
    """A person of the site, with the public key in hexadecimal and the role."""

    key: str
    role: Role


@dataclass(frozen=True)
class EnrolledRules:
    """A rule set that vehicles accept."""

    name: str
    approvals: Mapping[str, int] = field(default_factory=dict[str, int])
    """For each act that needs more than one approval, the number of people who must approve it."""


@dataclass(frozen=True)
class Roster:
    """The members of a site: people and stations by name, rule sets by SHA-256.

    A takeover whose epoch is below `epoch` is not valid, even at a vehicle that has lost the later
    takeovers.
    """

    serial: int = 0
    people: Mapping[str, Person] = field(default_factory=dict[str, Person])
    stations: Mapping[str, str] = field(default_factory=dict[str, str])
    rules: Mapping[str, EnrolledRules] = field(default_factory=dict[str, EnrolledRules])
    epoch: int = 0

    @classmethod
    def of(cls, claims: Mapping[str, Any]) -> Self:
        """Return the roster in `claims`; raises ValueError if a part is not valid."""
        roster = cls(
            whole_number(claims["serial"]),
            {name: Person(**person) for name, person in claims["people"].items()},
            dict(claims["stations"]),
            {sha: EnrolledRules(**rules) for sha, rules in claims["rules"].items()},
            whole_number(claims["epoch"]),
        )
        for name, person in roster.people.items():
            public_key(person.key)
            if person.role not in ROLES:
                raise ValueError(f"{name}: {person.role!r} is not a role")
        for key in roster.stations.values():
            public_key(key)
        for rules in roster.rules.values():
            for count in rules.approvals.values():
                whole_number(count)
        return roster

    def station_of(self, key: str) -> str:
        """Return the name of the station with the public key `key`; '' if there is none."""
        return next((name for name, its in self.stations.items() if its == key), "")


@dataclass(frozen=True)
class Approval:
    """One person's approval of a plan.

    `orders` are the commands of the plan and of its way to safety, each as `words` returns it.
    `station` is the public key of the station that may send them. `acts` are the acts beyond a
    plain approval: `override`, `acknowledge`. All hashes are SHA-256.
    """

    person: str
    station: str
    session: str
    request: str
    orders: tuple[str, ...]
    plan: str
    rules: str
    kind: Kind = "operator"
    acts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Grounds:
    """The basis of a command: the plan that was approved, and the signed approvals of it.

    `operator` is the person who made the decision. `approvals` has each signed approval by the name
    of the person.
    """

    operator: str
    session: str
    plan: str
    rules: str
    kind: Kind
    epoch: int
    approvals: Mapping[str, str]


def public_of(key: Ed25519PrivateKey) -> str:
    """Return the public key of `key`, 32 bytes in hexadecimal."""
    return key.public_key().public_bytes_raw().hex()


def digest(command: Command) -> str:
    """Return the SHA-256 of the entire content of `command`."""
    parts = [command.command_id, command.agent, command.verb, command.target]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def words(command: Command) -> str:
    """Return `command` in the words that people approve: agent, verb and target."""
    return " ".join(filter(None, (command.agent, command.verb, command.target)))


def sign_approval(key: Ed25519PrivateKey, approval: Approval, now: float) -> str:
    """Return `approval`, signed with the person's `key` and valid for APPROVAL_S from `now`."""
    return sign("approval", {**asdict(approval), "nbf": now, "exp": now + APPROVAL_S}, key)


def sign_command(
    key: Ed25519PrivateKey,
    command: Command,
    grounds: Grounds,
    now: float,
    *,
    head: str = "",
    serial: str = "",
) -> str:
    """Return the token for `command`, signed with the station's `key`; takes about 0.1 ms.

    `now` is in seconds since 1970. `head` is the head of the station's log, which contains the
    decision. `serial` is the vehicle's serial number; by default, the name of the command's agent.
    """
    claims = {
        "iss": public_of(key),
        "sub": grounds.operator,
        "aud": serial or command.agent,
        "jti": command.command_id,
        "nbf": now,
        "exp": now + TOKEN_S,
        "command": digest(command),
        "head": head,
        **{name: getattr(grounds, name) for name in _OF_GROUNDS},
        "approvals": dict(grounds.approvals),
    }
    return sign("command", claims, key)


def sign_roster(owner: Ed25519PrivateKey, roster: Roster) -> str:
    """Return `roster`, signed with the site owner's key.

    Receivers accept it only if its serial is higher than that of the last roster.
    """
    return sign("roster", asdict(roster), owner)


def sign_revocation(owner: Ed25519PrivateKey, serial: int, keys: Sequence[str]) -> str:
    """Return the message that revokes `keys`, signed with the site owner's key.

    `keys` must include every key that was revoked before, and `serial` must be higher than that of
    the last revocation.
    """
    return sign("revocation", {"serial": serial, "keys": sorted(keys)}, owner)


def sign_takeover(commander: Ed25519PrivateKey, person: str, epoch: int, station: str) -> str:
    """Return the message that puts a station in command, signed with the commander's key.

    `person` is the commander's name, and `station` is the station's public key.
    """
    return sign("takeover", {"person": person, "epoch": epoch, "station": station}, commander)


@dataclass(frozen=True)
class Records:
    """A part of the session log that a station shares.

    `first` and `last` are the numbers of the records; `head` is the hash of the last one.
    """

    session: str
    first: int
    last: int
    head: str


def sign_records(key: Ed25519PrivateKey, records: Records, now: float) -> str:
    """Return the message that confirms `records`, signed with the station's `key`."""
    return sign("records", {**asdict(records), "nbf": now, "exp": now + RECORDS_S}, key)


class RefusedError(Exception):
    """Raised with the reason if a message is not accepted."""


def sign(kind: Message, claims: Claims, key: Ed25519PrivateKey) -> str:
    """Return a message of the given `kind` with `claims`, signed with `key`."""
    payload = json.dumps(claims, separators=(",", ":")).encode()
    return _JWS.encode(payload, key, _ALGORITHM, headers={"typ": f"pa-{kind}+jwt"})


def open_message(
    message: str, kind: Message, key: Ed25519PublicKey, subject: str = "its authorization"
) -> Claims:
    """Return the claims of a `message` of the given `kind`, which must be signed with `key`.

    Raises RefusedError if the message is too long, altered, not in canonical form, of another kind,
    or signed with another key. `subject` is the name of the message in the reason.
    """
    if len(message) > MOST_CHARACTERS:
        raise RefusedError(f"{subject} is longer than {MOST_CHARACTERS} characters")
    try:
        opened = _JWS.decode_complete(message, key, [_ALGORITHM])
    except (jwt.InvalidSignatureError, InvalidSignature) as error:
        raise RefusedError(f"{subject} was altered, or signed with a wrong key") from error
    except jwt.InvalidTokenError as error:
        raise RefusedError(f"{subject} cannot be read: {error}") from error
    # Base64 can encode one signature in several ways. Only the canonical one is accepted, so that
    # an altered copy of a message cannot pass as a different message.
    if message.rpartition(".")[2] != base64url_encode(opened["signature"]).decode():
        raise RefusedError(f"{subject} is not in canonical form")
    if opened["header"].get("typ") != f"pa-{kind}+jwt":
        raise RefusedError(f"{subject} is a message of another kind")
    return read_claims(opened["payload"])


def check_time(claims: Claims, subject: str, most_s: float, now: float) -> None:
    """Raise RefusedError if `claims` are not valid at `now`, or for more than `most_s` seconds."""
    begins, ends = claims["nbf"], claims["exp"]
    if not (is_time(begins) and is_time(ends) and ends - begins <= most_s + ROUNDING_S):
        raise RefusedError(f"{subject} is not limited to {most_s:.0f} s")
    if not now >= begins - LEEWAY_S:
        raise RefusedError(f"{subject} becomes valid only in {begins - now:.1f} s")
    if not now <= ends + LEEWAY_S:
        raise RefusedError(f"{subject} expired {now - ends:.1f} s ago")


def read_claims(payload: bytes) -> Claims:
    """Return the claims in `payload`.

    Raises ValueError if it is not JSON, and RefusedError if it is not an object.
    """
    claims: object = json.loads(payload)
    if not isinstance(claims, dict):
        raise RefusedError("its authorization has no claims")
    return cast(Claims, claims)


def unverified(message: str) -> Claims:
    """Return the claims of `message` without checking its signature."""
    return read_claims(
        _JWS.decode_complete(message, options={"verify_signature": False})["payload"]
    )


def kind_of(message: str) -> str:
    """Return the kind in the header of `message`; raises RefusedError if it is too long."""
    if len(message) > MOST_CHARACTERS:
        raise RefusedError(f"it is longer than {MOST_CHARACTERS} characters")
    typ = str(_JWS.get_unverified_header(message).get("typ"))
    return typ.removeprefix("pa-").removesuffix("+jwt")


@lru_cache(maxsize=256)
def public_key(key: str) -> Ed25519PublicKey:
    """Return the public key from 32 bytes in hexadecimal; raises ValueError if it is not valid."""
    return Ed25519PublicKey.from_public_bytes(bytes.fromhex(key))


def whole_number(value: object) -> int:
    """Return `value` as a serial or an epoch; raises ValueError if it cannot be one."""
    if type(value) is not int or not 0 <= value < 2**53:
        raise ValueError(f"{value!r} is not a whole number from 0 on")
    return value


def is_time(value: object) -> TypeGuard[float]:
    """Return whether `value` is a number; a bool does not count as a number."""
    return type(value) in (int, float)


@dataclass(frozen=True)
class UnsignedApproval:
    """An approval that is ready for signing.

    `text` is the header and the claims of a JWT, in ASCII. The signature is Ed25519 (RFC 8032)
    over the bytes of `text`. The signed approval is `text`, a full stop, and the 64 bytes of the
    signature in base64url without padding. `begins` and `ends` are in seconds since 1970.
    """

    text: str
    approval: Approval
    begins: float
    ends: float

    @classmethod
    def of(cls, approval: Approval, now: float) -> Self:
        """Return `approval` ready for signing, valid for APPROVAL_S from `now`."""
        ends = now + APPROVAL_S
        claims = {**asdict(approval), "nbf": now, "exp": ends}
        return cls(f"{_packed(_APPROVAL_HEADER)}.{_packed(claims)}", approval, now, ends)

    @classmethod
    def read(cls, text: str) -> Self:
        """Return the approval in `text`; raises RefusedError if `text` is anything else.

        Takeovers, rosters and commands are refused, so that nobody signs one of them in place of an
        approval.
        """
        try:
            header, claims = _opened(text)
            if header != _APPROVAL_HEADER:
                raise RefusedError("this is a message of another kind than an approval")
            named = {name.name for name in fields(Approval)} | {"nbf", "exp"}
            if claims.keys() != named:
                raise RefusedError("this approval does not have exactly the parts of an approval")
            check_time(claims, "this approval", APPROVAL_S, claims["nbf"])
            return cls(text, _approval(claims), claims["nbf"], claims["exp"])
        except RefusedError:
            raise
        except (ValueError, KeyError, TypeError) as error:
            raise RefusedError(f"this cannot be signed: {error}") from error

    @property
    def sha256(self) -> str:
        """The SHA-256 of `text`, in hexadecimal."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def signed(self, key: Ed25519PrivateKey) -> str:
        """Return the approval, signed with the person's `key`."""
        signature = key.sign(self.text.encode("ascii"))
        return f"{self.text}.{base64url_encode(signature).decode()}"


def _packed(content: Mapping[str, object]) -> str:
    return base64url_encode(json.dumps(content, separators=(",", ":")).encode()).decode()


def _opened(text: str) -> tuple[Claims, Claims]:
    if len(text) > MOST_CHARACTERS or not text.isascii():
        raise RefusedError(f"only ASCII text of at most {MOST_CHARACTERS} characters can be signed")
    first, dot, second = text.partition(".")
    packed = [base64url_encode(base64url_decode(part)).decode() for part in (first, second)]
    if not dot or packed != [first, second]:
        raise RefusedError("this cannot be signed: it must consist of two parts in base64url")
    return read_claims(base64url_decode(first)), read_claims(base64url_decode(second))


def _approval(claims: Claims) -> Approval:
    """Return the approval in `claims`; raises ValueError if a part has the wrong type."""
    texts = {part: claims[part] for part in _TEXTS}
    if not all(isinstance(value, str) for value in texts.values()) or claims["kind"] not in KINDS:
        raise ValueError("a part of it has an unknown kind")
    orders, acts = _texts(claims["orders"], "orders"), _texts(claims["acts"], "acts")
    return Approval(**texts, orders=orders, kind=claims["kind"], acts=acts)


def _texts(value: Any, part: str) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise ValueError(f"{part} is not a list")
    items = cast(list[object], value)
    texts = tuple(item for item in items if isinstance(item, str))
    if len(texts) != len(items):
        raise ValueError(f"{part} has an item that is not a text")
    return texts
