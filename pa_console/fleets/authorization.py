"""Authorizations: proof, at the vehicle, that named people have approved this very command.

People sign approvals, a station signs a token for each command with the approvals in it, and the
`Verifier` of a vehicle checks both against the roster that the owner of the site has signed. All of
them are JWTs, signed with Ed25519 ("EdDSA"). This file needs pyjwt, cryptography and the standard
library and no other part of this package: a vehicle may have a copy of it.
"""

import hashlib
import json
import sqlite3
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, Protocol, Self, TypeGuard, cast

import jwt
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from jwt.utils import base64url_encode

Role = Literal["observer", "operator", "commander"]
ROLES: tuple[Role, ...] = ("observer", "operator", "commander")
"""What a person may do, each more than the one before: watch, approve, put a station in command."""

Kind = Literal["operator", "override", "standing"]
KINDS: tuple[Kind, ...] = ("operator", "override", "standing")
"""How a person approved: after looking, against the judge with a reason, or beforehand."""

Message = Literal["command", "approval", "roster", "revocation", "takeover"]
UNSIGNED = frozenset(("hold",))
"""The commands that never need a token: nothing may stand in the way of a stop."""

TOKEN_S = 30.0
"""How long a token is good for, at most; a command that is sent again gets another one."""

APPROVAL_S = 3600.0
"""How long what people approved may be carried out, at most: a plan, and its way to safety."""

LEEWAY_S = 2.0
"""So far may the clocks of a station and a vehicle be apart."""

MOST_USED = 4096
"""So many used tokens are remembered; what is older than all of them is refused unread."""

MOST_CHARACTERS = 65_536
ROUNDING_S = 0.001
_ALGORITHM = "EdDSA"
_JWS = jwt.PyJWS(algorithms=[_ALGORITHM])
_Claims = dict[str, Any]


class Command(Protocol):
    """A command as a vehicle gets it; `target` is None for one without a frame."""

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
    """Somebody of the site: the public key in hexadecimal, and what it may do."""

    key: str
    role: Role


@dataclass(frozen=True)
class EnrolledRules:
    """A rule set that plans may be checked by, and how many people must approve what."""

    name: str
    approvals: Mapping[str, int] = field(default_factory=dict[str, int])


@dataclass(frozen=True)
class Roster:
    """Who and what belongs to a site: people and stations by name, rule sets by SHA-256.

    No takeover below `epoch` counts any more, even at a vehicle that has forgotten those after it.
    """

    serial: int = 0
    people: Mapping[str, Person] = field(default_factory=dict[str, Person])
    stations: Mapping[str, str] = field(default_factory=dict[str, str])
    rules: Mapping[str, EnrolledRules] = field(default_factory=dict[str, EnrolledRules])
    epoch: int = 0

    @classmethod
    def of(cls, claims: Mapping[str, Any]) -> Self:
        """Return the roster that `claims` are; raises ValueError for what is none."""
        roster = cls(
            _number(claims["serial"]),
            {name: Person(**person) for name, person in claims["people"].items()},
            dict(claims["stations"]),
            {sha: EnrolledRules(**rules) for sha, rules in claims["rules"].items()},
            _number(claims["epoch"]),
        )
        for name, person in roster.people.items():
            _public(person.key)
            if person.role not in ROLES:
                raise ValueError(f"{name}: {person.role!r} is no role")
        for key in roster.stations.values():
            _public(key)
        for rules in roster.rules.values():
            for count in rules.approvals.values():
                _number(count)
        return roster

    def station_of(self, key: str) -> str:
        """Return the name of the station with the public key `key`, '' for none."""
        return next((name for name, its in self.stations.items() if its == key), "")


@dataclass(frozen=True)
class Approval:
    """What one person approves: the plan's orders and its way to safety, each in words.

    `station` is the public key of the station that may send them; `acts` are what needs more than
    a plan without objections does: `override`, `acknowledge`. All hashes are SHA-256.
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
    """What a command rests on: signed approvals by the person's name, and what they are about.

    `operator` is the person whose decision it was.
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
    """Return the SHA-256 of everything that `command` says."""
    said = [command.command_id, command.agent, command.verb, command.target]
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()


def words(command: Command) -> str:
    """Return `command` as people approve it: agent, verb and target."""
    return " ".join(filter(None, (command.agent, command.verb, command.target)))


def sign_approval(key: Ed25519PrivateKey, approval: Approval, now: float) -> str:
    """Return `approval` signed by the person's own `key`, good for APPROVAL_S from `now`."""
    return _sign("approval", {**asdict(approval), "nbf": now, "exp": now + APPROVAL_S}, key)


def sign_command(
    key: Ed25519PrivateKey,
    command: Command,
    grounds: Grounds,
    now: float,
    *,
    head: str = "",
    serial: str = "",
) -> str:
    """Return the token with which the station that has `key` sends `command`; takes about 0.1 ms.

    `now` is in seconds since 1970, `head` the head of the station's log, which holds the decision.
    The vehicle's `serial` is by default the command's agent.
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
    return _sign("command", claims, key)


_OF_GROUNDS = ("session", "plan", "rules", "kind", "epoch")


def sign_roster(owner: Ed25519PrivateKey, roster: Roster) -> str:
    """Return `roster` signed by the owner of the site; its serial must be higher than the last."""
    return _sign("roster", asdict(roster), owner)


def sign_revocation(owner: Ed25519PrivateKey, serial: int, keys: Sequence[str]) -> str:
    """Return the message that revokes `keys`, all there ever were; `serial` only grows."""
    return _sign("revocation", {"serial": serial, "keys": sorted(keys)}, owner)


def sign_takeover(commander: Ed25519PrivateKey, person: str, epoch: int, station: str) -> str:
    """Return the message with which a commander puts the station of that key in command."""
    return _sign("takeover", {"person": person, "epoch": epoch, "station": station}, commander)


class RefusedError(Exception):
    """Why something is not accepted, in words."""


@dataclass(frozen=True)
class Takeover:
    """Which station is in command: the epoch that a commander has signed for it."""

    epoch: int = 0
    station: str = ""
    person: str = ""


class Trust:
    """What a vehicle or a station goes by: the roster, what was revoked, and who is in command.

    It begins with the public key of the site's owner and takes signed messages, each only if it is
    newer than the one before.
    """

    def __init__(self, owner: str) -> None:
        """`owner` is 32 bytes in hexadecimal; raises ValueError when it is no public key."""
        self._owner = _public(owner)
        self.roster = Roster()
        self.revoked: frozenset[str] = frozenset()
        self.revocation = 0
        """The serial of the last revocation."""
        self.takeover = Takeover()

    @property
    def in_command(self) -> str:
        """The station in command, in words."""
        if not self.takeover.epoch:
            return "no station is in command: a commander has to sign for one"
        name = self.roster.station_of(self.takeover.station) or "a station that is not enrolled"
        return f"{name} is in command since epoch {self.takeover.epoch}"

    def take(self, message: str) -> str:
        """Accept a signed roster, revocation or takeover; return why not, '' when it is taken.

        The same message again is taken and changes nothing.
        """
        try:
            match _kind(message):
                case "roster":
                    self._take_roster(_open(message, "roster", self._owner))
                case "revocation":
                    self._take_revocation(_open(message, "revocation", self._owner))
                case "takeover":
                    self._take_takeover(message)
                case other:
                    return f"a message of the kind {other!r} changes no trust"
        except RefusedError as refused:
            return str(refused)
        except Exception as error:
            return f"it cannot be read: {error}"
        return ""

    def person(self, name: str) -> Person:
        """Return the person called `name`; raises RefusedError for nobody, and a revoked one."""
        person = self.roster.people.get(name)
        if person is None:
            raise RefusedError(f"{name!r} is not in the roster")
        if person.key in self.revoked:
            raise RefusedError(f"the key of {name} was revoked")
        return person

    def approver(self, name: str) -> Person:
        """Return the person called `name`, who may approve; raises RefusedError otherwise."""
        person = self.person(name)
        if ROLES.index(person.role) < ROLES.index("operator"):
            raise RefusedError(f"{name} has the role {person.role}, which may approve nothing")
        return person

    def approval(self, name: str, message: str, now: float) -> tuple[_Claims, str]:
        """Return what the person called `name` has approved, and the public key of it.

        Raises RefusedError for what nobody signed who may approve, and for what is out of date.
        """
        person, what = self.approver(name), f"the approval of {name}"
        approval = _open(message, "approval", _public(person.key), what)
        _check_time(approval, what, APPROVAL_S, now)
        if approval["person"] != name or type(approval["orders"]) is not list:
            raise RefusedError(f"{what} is not what it should be")
        return approval, person.key

    def _take_roster(self, claims: _Claims) -> None:
        roster = Roster.of(claims)
        if roster.serial < self.roster.serial or (
            roster.serial == self.roster.serial and roster != self.roster
        ):
            raise RefusedError(f"roster {roster.serial} is not newer than {self.roster.serial}")
        self.roster = roster

    def _take_revocation(self, claims: _Claims) -> None:
        serial, keys = _number(claims["serial"]), frozenset[str](claims["keys"])
        if serial < self.revocation or (serial == self.revocation and keys != self.revoked):
            raise RefusedError(f"revocation {serial} is not newer than {self.revocation}")
        if not keys >= self.revoked:
            raise RefusedError("a revoked key stays revoked")
        self.revocation, self.revoked = serial, keys

    def _take_takeover(self, message: str) -> None:
        claimed = _unverified(message)
        name = str(claimed.get("person"))
        person = self.person(name)
        if person.role != "commander":
            raise RefusedError(f"{name} has the role {person.role}; only a commander gives command")
        claims = _open(message, "takeover", _public(person.key))
        taken = Takeover(_number(claims["epoch"]), str(claims["station"]), name)
        if taken.epoch < self.roster.epoch:
            raise RefusedError(f"epoch {taken.epoch} is over: the roster is of {self.roster.epoch}")
        if taken.epoch == self.takeover.epoch and taken.station == self.takeover.station:
            return
        if taken.epoch <= self.takeover.epoch:
            raise RefusedError(f"epoch {taken.epoch} is not newer; {self.in_command}")
        self.takeover = taken


class Memory:
    """What a vehicle must not forget: what it has used, and the newest signed messages.

    With a `path` it survives a restart, and a power cut: a token is on the disk before its command
    is carried out. Raises OSError or sqlite3.Error when that file cannot be used.
    """

    def __init__(self, path: Path | None = None, most: int = MOST_USED) -> None:
        """At `most` so many are remembered of each kind."""
        self._most = most
        if path is not None:
            path.touch(mode=0o600)
        self._base = sqlite3.connect(str(path or ":memory:"), check_same_thread=False)
        self._base.executescript(
            "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;"
            "CREATE TABLE IF NOT EXISTS used"
            " (kind TEXT, name TEXT, until REAL NOT NULL, PRIMARY KEY (kind, name));"
            "CREATE INDEX IF NOT EXISTS used_until ON used (kind, until);"
            "CREATE TABLE IF NOT EXISTS kept (name TEXT PRIMARY KEY, value TEXT NOT NULL);"
        )
        query = "SELECT kind, count(*) FROM used GROUP BY kind"
        self._count = {str(kind): int(count) for kind, count in self._base.execute(query)}

    def use(self, kind: str, name: str, until: float) -> Literal["", "used", "forgotten"]:
        """Remember that `name`, good `until` then, is used; "" if it was not used before.

        What ended no later than something that was forgotten may have been used: "forgotten".
        """
        if until <= float(self.kept(f"{kind} horizon") or 0.0):
            return "forgotten"
        with self._base:
            try:
                self._base.execute("INSERT INTO used VALUES (?, ?, ?)", (kind, name, until))
            except sqlite3.IntegrityError:
                return "used"
            self._count[kind] = self._count.get(kind, 0) + 1
            if self._count[kind] > self._most:
                self._forget(kind)
        return ""

    def kept(self, name: str) -> str:
        """Return what is kept under `name`, '' for nothing."""
        row = self._base.execute("SELECT value FROM kept WHERE name = ?", (name,)).fetchone()
        return str(row[0]) if row is not None else ""

    def keep(self, name: str, value: str) -> None:
        """Keep `value` under `name`, in place of what was there."""
        with self._base:
            self._base.execute("INSERT OR REPLACE INTO kept VALUES (?, ?)", (name, value))

    def close(self) -> None:
        """Let go of the file."""
        self._base.close()

    def _forget(self, kind: str) -> None:
        """Forget the half that ends first; nothing that ended by then is ever taken again."""
        query = "SELECT until FROM used WHERE kind = ? ORDER BY until LIMIT 1 OFFSET ?"
        row = self._base.execute(query, (kind, self._count[kind] // 2)).fetchone()
        query = "DELETE FROM used WHERE kind = ? AND until <= ?"
        self._count[kind] -= self._base.execute(query, (kind, row[0])).rowcount
        horizon = (f"{kind} horizon", repr(float(row[0])))
        self._base.execute("INSERT OR REPLACE INTO kept VALUES (?, ?)", horizon)


_ONE_APPROVAL = ("person", "station", "session", "request", "nbf")
_USED = {
    "used": "used before",
    "forgotten": "made before anything that this vehicle remembers",
}


class Verifier:
    """Decides, at one vehicle, whether a command may be carried out; whatever goes wrong, it not.

    A vehicle that has a command's id already repeats its last answer and does not ask again.
    """

    def __init__(
        self,
        serial: str,
        owner: str,
        memory: Memory | None = None,
        now: Callable[[], float] = time.time,
    ) -> None:
        """`serial` is the vehicle's, `owner` the public key of the site's owner, `now` its clock.

        Raises ValueError for a memory that is of a vehicle of another owner.
        """
        self.serial, self.trust, self._now = serial, Trust(owner), now
        self._memory = memory if memory is not None else Memory()
        self._fresh = not self._memory.kept("commanded")
        if (kept := self._memory.kept("owner")) not in ("", owner):
            raise ValueError(f"this memory belongs to a vehicle of the owner {kept}")
        self._memory.keep("owner", owner)
        self._recall()

    def take(self, message: str) -> str:
        """Accept a signed roster, revocation or takeover; return why not, '' when it is taken."""
        trust, why = self.trust, self.trust.take(message)
        if not why:
            state = {
                "roster": asdict(trust.roster),
                "revoked": [trust.revocation, sorted(trust.revoked)],
                "takeover": asdict(trust.takeover),
            }
            try:
                self._memory.keep("trust", json.dumps(state))
            except sqlite3.Error as error:
                return f"it holds until a restart alone, for it cannot be kept: {error}"
        return why

    def verify(self, token: str | None, command: Command) -> str:
        """Return why `command` is refused, '' when it may be carried out now, and this once."""
        try:
            if command.verb in UNSIGNED:
                return ""
            if not token:
                raise RefusedError("it has no authorization")
            claims = self._opened(token)
            self._check_command(claims, command)
            _check_time(claims, "its authorization", TOKEN_S, self._now())
            approvals = self._check_approvals(claims, command)
            self._use(claims, approvals, command)
            if self._fresh:
                self._memory.keep("commanded", "yes")
                self._fresh = False
        except RefusedError as refused:
            return str(refused)
        except Exception as error:
            return f"its authorization cannot be checked: {type(error).__name__}: {error}"
        return ""

    def _recall(self) -> None:
        """Go by what was taken before a restart; it was checked when it came."""
        if not (kept := self._memory.kept("trust")):
            return
        state, trust = json.loads(kept), self.trust
        trust.roster = Roster.of(state["roster"])
        trust.revocation, trust.revoked = state["revoked"][0], frozenset(state["revoked"][1])
        trust.takeover = Takeover(**state["takeover"])

    def _opened(self, token: str) -> _Claims:
        """Return what the station in command has signed; raises RefusedError for anybody else's."""
        trust = self.trust
        station = trust.takeover.station
        if not trust.takeover.epoch:
            raise RefusedError(trust.in_command)
        if station in trust.revoked:
            raise RefusedError("the key of the station in command was revoked")
        if not trust.roster.station_of(station):
            raise RefusedError("the station in command is no longer enrolled")
        try:
            claims = _open(token, "command", _public(station))
        except RefusedError:
            with suppress(jwt.InvalidTokenError, ValueError, TypeError):
                self._explain(token)
            raise
        if claims["iss"] != station:
            raise RefusedError("its authorization names another key than it was signed with")
        epoch = _number(claims["epoch"])
        if epoch < trust.takeover.epoch:
            raise RefusedError(f"its authorization is of epoch {epoch}; {trust.in_command}")
        if epoch > trust.takeover.epoch:
            raise RefusedError(f"nobody has told this vehicle of epoch {epoch}; {trust.in_command}")
        return claims

    def _explain(self, token: str) -> None:
        """Raise a better reason for a token that another station has signed, if one has."""
        claimed = str(_unverified(token).get("iss"))
        name = self.trust.roster.station_of(claimed)
        if name and claimed != self.trust.takeover.station:
            epoch = _number(_open(token, "command", _public(claimed))["epoch"])
            raise RefusedError(f"{name} signed it in epoch {epoch}; {self.trust.in_command}")

    def _check_command(self, claims: _Claims, command: Command) -> None:
        if claims["aud"] != self.serial:
            raise RefusedError(f"its authorization is for {claims['aud']}, not for {self.serial}")
        if claims["jti"] != command.command_id or claims["command"] != digest(command):
            raise RefusedError("its authorization is for another command")

    def _check_approvals(self, claims: _Claims, command: Command) -> list[_Claims]:
        """Return the approvals, once as many people as the rules ask have signed each their own."""
        rules = self.trust.roster.rules.get(claims["rules"])
        if rules is None:
            raise RefusedError(f"the rule set {claims['rules'][:12]} is not enrolled")
        signers: dict[str, set[str]] = {command.verb: set()}
        approvals: list[_Claims] = []
        for name, message in claims["approvals"].items():
            approval, key = self._opened_approval(name, message, claims, command)
            approvals.append(approval)
            for act in (command.verb, *approval["acts"]):
                signers.setdefault(act, set()).add(key)
            if name == claims["sub"] and approval["kind"] != claims["kind"]:
                raise RefusedError(f"{name} has not approved it as {claims['kind']!r}")
        if claims["sub"] not in claims["approvals"]:
            raise RefusedError(f"{claims['sub']} has not approved it")
        if self._fresh:
            signers["first_order"] = signers[command.verb]
        for act, keys in signers.items():
            asked = max(rules.approvals.get(act, 1), 1)
            if len(keys) < asked:
                raise RefusedError(f"{act} needs {asked} approvals, and it has {len(keys)}")
        return approvals

    def _use(self, claims: _Claims, approvals: Sequence[_Claims], command: Command) -> None:
        """Use the token up, and of each approval one of the orders of these words.

        So whoever has stolen a station's key repeats nothing that people approved once.
        """
        token = f"{claims['iss']}/{claims['session']}/{claims['jti']}"
        if why := self._memory.use("token", token, claims["exp"]):
            raise RefusedError(f"its authorization was {_USED[why]}")
        said = words(command)
        for approval in approvals:
            order = json.dumps([approval[part] for part in _ONE_APPROVAL] + [said])
            for number in range(approval["orders"].count(said)):
                why = self._memory.use("order", f"{order}/{number}", approval["exp"])
                if why != "used":
                    break
            if why:
                raise RefusedError(f"what {approval['person']} approved was {_USED[why]}")

    def _opened_approval(
        self, name: str, message: str, token: _Claims, command: Command
    ) -> tuple[_Claims, str]:
        """Return what the person called `name` has signed, and the key that it is signed with."""
        what = f"the approval of {name}"
        approval, key = self.trust.approval(name, message, self._now())
        if approval["station"] != token["iss"]:
            raise RefusedError(f"{what} was not given to this station")
        if any(approval[part] != token[part] for part in ("session", "plan", "rules")):
            raise RefusedError(f"{what} is for another plan or another rule set")
        if words(command) not in approval["orders"]:
            raise RefusedError(f"{what} is not for {words(command)}")
        return approval, key


def _sign(kind: Message, claims: _Claims, key: Ed25519PrivateKey) -> str:
    payload = json.dumps(claims, separators=(",", ":")).encode()
    return _JWS.encode(payload, key, _ALGORITHM, headers={"typ": f"pa-{kind}+jwt"})


def _open(
    message: str, kind: Message, key: Ed25519PublicKey, what: str = "its authorization"
) -> _Claims:
    """Return the claims of a message of that kind; raises RefusedError unless `key` signed it."""
    if len(message) > MOST_CHARACTERS:
        raise RefusedError(f"{what} is longer than {MOST_CHARACTERS} characters")
    try:
        opened = _JWS.decode_complete(message, key, [_ALGORITHM])
    except (jwt.InvalidSignatureError, InvalidSignature) as error:
        raise RefusedError(f"{what} was altered, or signed with a wrong key") from error
    except jwt.InvalidTokenError as error:
        raise RefusedError(f"{what} cannot be read: {error}") from error
    if message.rpartition(".")[2] != base64url_encode(opened["signature"]).decode():
        raise RefusedError(f"{what} is not written in the one way there is")
    if opened["header"].get("typ") != f"pa-{kind}+jwt":
        raise RefusedError(f"{what} is a message of another kind")
    return _claims(opened["payload"])


def _check_time(claims: _Claims, what: str, most_s: float, now: float) -> None:
    """Raise RefusedError unless `claims` hold at `now`, and for no longer than `most_s`."""
    begins, ends = claims["nbf"], claims["exp"]
    if not (_is_time(begins) and _is_time(ends) and ends - begins <= most_s + ROUNDING_S):
        raise RefusedError(f"{what} is not limited to {most_s:.0f} s")
    if not now >= begins - LEEWAY_S:
        raise RefusedError(f"{what} is not valid for another {begins - now:.1f} s")
    if not now <= ends + LEEWAY_S:
        raise RefusedError(f"{what} expired {now - ends:.1f} s ago")


def _claims(payload: bytes) -> _Claims:
    claims: object = json.loads(payload)
    if not isinstance(claims, dict):
        raise RefusedError("its authorization has no claims")
    return cast(_Claims, claims)


def _unverified(message: str) -> _Claims:
    """Return what a message claims; nobody has vouched for it yet."""
    return _claims(_JWS.decode_complete(message, options={"verify_signature": False})["payload"])


def _kind(message: str) -> str:
    if len(message) > MOST_CHARACTERS:
        raise RefusedError(f"it is longer than {MOST_CHARACTERS} characters")
    typ = str(_JWS.get_unverified_header(message).get("typ"))
    return typ.removeprefix("pa-").removesuffix("+jwt")


@lru_cache(maxsize=256)
def _public(key: str) -> Ed25519PublicKey:
    """Return the public key of 32 bytes in hexadecimal; raises ValueError for what is none."""
    return Ed25519PublicKey.from_public_bytes(bytes.fromhex(key))


def _number(value: object) -> int:
    if type(value) is not int or not 0 <= value < 2**53:
        raise ValueError(f"{value!r} is no number from 0 on")
    return value


def _is_time(value: object) -> TypeGuard[float]:
    return type(value) in (int, float)
