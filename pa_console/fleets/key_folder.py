"""The site's keys on this machine (of its owner, stations and people), and its signed messages.

Both are in the folder `site-keys` beside this machine's signing key, readable only by the user. The
other machines of the site do not have the owner's key; they receive the signed messages from the
site.
"""

import re
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization as form
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from filelock import FileLock, Timeout

from pa_console.fleets.authorization import (
    KINDS_OF_TRUST,
    EnrolledRules,
    Person,
    Role,
    Roster,
    Takeover,
    Trust,
    public_of,
    sign_revocation,
    sign_roster,
    sign_takeover,
)
from pa_console.fleets.station_authority import Keys
from pa_console.private_files import (
    FILE_MODE,
    NotPrivateError,
    make_private_folder,
    read_private,
    replace_private,
)
from pa_console.signing import LOCK_SECONDS, SITE_OWNER, SigningError, site_keys

OWNER = "owner"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")

AskPassphrase = Callable[[str], str]
"""A function that returns the passphrase of the key with the given name."""


@dataclass(frozen=True)
class ListedKey:
    """One key of the site; `here` is True if it is on this machine.

    `state` is `in force`, `in command` or `revoked`.
    """

    kind: str
    name: str
    role: str
    key: str
    state: str
    here: bool


class KeyFolder:
    """The folder with the keys of one site; errors are SigningErrors with a path and a remedy."""

    def __init__(self, path: Path | None = None, ask: AskPassphrase | None = None) -> None:
        """Use the folder at `path`, by default beside the signing key; nothing is read yet.

        `ask` returns the passphrase of a protected key.
        """
        self.path = path if path is not None else site_keys()
        self._ask = ask

    @property
    def made(self) -> bool:
        """True if the folder has the keys of a site."""
        return self._file(SITE_OWNER).exists()

    @property
    def owner(self) -> str:
        """The public key of the site's owner, 32 bytes in hexadecimal."""
        return self._read(SITE_OWNER).decode("ascii", "replace").strip()

    @property
    def messages(self) -> tuple[str, ...]:
        """The newest signed roster, revocation and takeover in the folder."""
        return tuple(self.newest.values())

    @property
    def newest(self) -> dict[str, str]:
        """The newest signed message of each kind in the folder."""
        return {name: message for name in KINDS_OF_TRUST if (message := self._message(name))}

    def trust(self) -> Trust:
        """Return the trust that results from the signed messages.

        A takeover that is no longer valid is ignored, and then no station is in command.
        """
        self._require_site()
        try:
            trust = Trust(self.owner)
        except ValueError as error:
            raise SigningError(f"{self.path}/{SITE_OWNER}: no public key: {error}") from error
        for name in KINDS_OF_TRUST:
            message = self._message(name)
            if message and (why := trust.take(message)) and name != "takeover":
                raise SigningError(f"{self.path}/{name}.jwt: it is not valid: {why}")
        return trust

    def keys(self, person: tuple[str, Ed25519PrivateKey] | None = None) -> Keys:
        """Return the keys with which this station and the person at it sign.

        They are the keys of the first station and the first person in the roster whose keys are on
        this machine. `person`, a name with a loaded key, replaces that person.
        """
        station = self._first("station", self.trust().roster.stations)
        name, own = person or self.person()
        return Keys(self._load("station", station), name, own, self.owner, self.messages)

    def person(self) -> tuple[str, Ed25519PrivateKey]:
        """Return name and key of the first person in the roster whose key is on this machine."""
        name = self._first("person", self.trust().roster.people)
        return name, self._load("person", name)

    def person_key(self, name: str) -> Ed25519PrivateKey:
        """Return the key of the person called `name`, who may be missing from the roster."""
        _named(name)
        return self._load("person", name)

    def make_site(
        self, person: str, station: str, rules: Mapping[str, EnrolledRules], passphrase: str = ""
    ) -> None:
        """Make the keys of a new site: the owner's, one station's, and one commander's.

        `passphrase` protects the owner's key and the person's key. The station's key has no
        passphrase, and the station is put in command. Raises ValueError if there are keys already.
        """
        with self._locked():
            if self.made:
                raise ValueError(f"{self.path}: there are keys already; see pa-console keys list")
            owner = self._make("owner", OWNER, passphrase)
            people = {
                person: Person(public_of(self._make("person", person, passphrase)), "commander")
            }
            stations = {station: public_of(self._make("station", station))}
            self._sign(owner, Roster(1, people, stations, dict(rules)))
            commander = self._load("person", person)
            self._keep("takeover", sign_takeover(commander, person, 1, stations[station]))
            replace_private(self._file(SITE_OWNER), public_of(owner).encode())

    def join(self, person: str, station: str, owner: str, passphrase: str = "") -> tuple[str, str]:
        """Make the keys of one more station and of one more person for the site of `owner`.

        Returns the public keys of the person and the station, which the owner has to enrol. Raises
        ValueError if there are keys already, or if `owner` is not a public key.
        """
        Trust(owner)
        with self._locked():
            if self.made:
                raise ValueError(f"{self.path}: there are keys already; see pa-console keys list")
            own = public_of(self._make("person", person, passphrase))
            its = public_of(self._make("station", station))
            replace_private(self._file(SITE_OWNER), owner.encode())
            return own, its

    def make_person(self, name: str, role: Role, passphrase: str = "") -> None:
        """Make a key for one more person of the site, and enrol the person."""
        with self._locked():
            owner, roster = self._owner(), self.trust().roster
            if name in roster.people:
                raise ValueError(f"{name} is in the roster already; see pa-console keys list")
            made = Person(public_of(self._make("person", name, passphrase)), role)
            self._sign(owner, replace(roster, people={**roster.people, name: made}))

    def enrol_person(self, name: str, key: str, role: Role) -> None:
        """Add the person with the public `key` to the roster, or change the person's role."""
        _named(name)
        with self._locked():
            owner, roster = self._owner(), self.trust().roster
            if name in roster.people and roster.people[name].key != key:
                raise ValueError(f"{name} has another key in the roster; revoke that one first")
            people = {**roster.people, name: Person(key, role)}
            self._sign(owner, replace(roster, people=people))

    def enrol_station(self, name: str, key: str) -> None:
        """Add the station with the public `key` to the roster."""
        _named(name)
        with self._locked():
            owner, roster = self._owner(), self.trust().roster
            if roster.stations.get(name, key) != key:
                raise ValueError(f"{name} has another key in the roster; revoke that one first")
            self._sign(owner, replace(roster, stations={**roster.stations, name: key}))

    def enrol_rules(self, content_sha256: str, rules: EnrolledRules) -> None:
        """Enrol a rule set and the numbers of approvals that it requires.

        The rule set replaces any other of the same name.
        """
        with self._locked():
            owner, roster = self._owner(), self.trust().roster
            kept = {sha: its for sha, its in roster.rules.items() if its.name != rules.name}
            self._sign(owner, replace(roster, rules={**kept, content_sha256: rules}))

    def revoke(self, name: str) -> None:
        """Revoke the key of a person or station for ever, and remove `name` from the roster.

        If the station in command was put there by the revoked commander, another commander with a
        key on this machine signs a new takeover for that station.
        """
        with self._locked():
            owner, trust = self._owner(), self.trust()
            roster = trust.roster
            key = _key_of(name, roster)
            people = {each: its for each, its in roster.people.items() if its.key != key}
            stations = {each: its for each, its in roster.stations.items() if its != key}
            self._revoke(owner, trust, key)
            self._sign(owner, replace(roster, people=people, stations=stations))
            if trust.takeover.person == name and trust.takeover.station in stations.values():
                self._take_over(roster.station_of(trust.takeover.station))

    def rotate(self, name: str, passphrase: str = "") -> None:
        """Make a new key for a person or station of this machine, and revoke the old key.

        If the current takeover depends on the old key, a commander with a key on this machine signs
        a new takeover for the same station.
        """
        with self._locked():
            owner, trust = self._owner(), self.trust()
            roster, before = trust.roster, _key_of(name, trust.roster)
            commanding = roster.station_of(trust.takeover.station)
            again = name in (commanding, trust.takeover.person)
            if name in roster.people:
                # Only a key that is on this machine can be replaced, with its passphrase.
                self._load("person", name)
                made = Person(
                    public_of(self._make("person", name, passphrase)), roster.people[name].role
                )
                roster = replace(roster, people={**roster.people, name: made})
            else:
                self._load("station", name)
                key = public_of(self._make("station", name))
                roster = replace(roster, stations={**roster.stations, name: key})
            self._revoke(owner, trust, before)
            self._sign(owner, roster)
            if again and commanding:
                self._take_over(commanding)

    def take_over(self, station: str) -> Takeover:
        """Put `station` in command, signed with the first commander's key on this machine."""
        with self._locked():
            return self._take_over(station)

    def take(self, message: str) -> str:
        """Store a signed message from the site; return the reason if it is refused, else ''."""
        with self._locked():
            trust = self.trust()
            before = trust.roster.serial, trust.revocation, trust.takeover
            if why := trust.take(message):
                return why
            after = trust.roster.serial, trust.revocation, trust.takeover
            for name, one, other in zip(KINDS_OF_TRUST, before, after, strict=True):
                if one != other:
                    self._keep(name, message)
            return ""

    def listed(self) -> list[ListedKey]:
        """Return all keys of the site."""
        trust = self.trust()
        roster = trust.roster
        rows = [("owner", OWNER, "", self.owner)]
        rows += [("station", name, "", key) for name, key in roster.stations.items()]
        rows += [("person", name, its.role, its.key) for name, its in roster.people.items()]
        rows += [("revoked", "", "", key) for key in sorted(trust.revoked)]
        return [
            ListedKey(
                kind,
                name,
                role,
                key,
                "revoked" if key in trust.revoked
                else "in command" if key == trust.takeover.station
                else "in force",
                bool(name) and self._file(_pem(kind, name)).exists(),
            )
            for kind, name, role, key in rows
        ]  # fmt: skip

    def _take_over(self, station: str) -> Takeover:
        trust = self.trust()
        key = trust.roster.stations.get(station)
        if key is None:
            stations = ", ".join(trust.roster.stations)
            raise ValueError(f"there is no station {station!r}; known: {stations}")
        people = {n: p for n, p in trust.roster.people.items() if p.role == "commander"}
        person = self._first("person", people)
        commander = self._load("person", person)
        message = sign_takeover(commander, person, trust.next_epoch, key)
        if why := trust.take(message):
            raise ValueError(f"{station} cannot take over: {why}")
        self._keep("takeover", message)
        return trust.takeover

    def _sign(self, owner: Ed25519PrivateKey, roster: Roster) -> None:
        """Sign `roster` with the next serial; takeovers of earlier epochs become invalid."""
        serial, epoch = 1, 1
        if self.made:
            trust = self.trust()
            serial, epoch = trust.roster.serial + 1, max(trust.takeover.epoch, trust.roster.epoch)
        self._keep("roster", sign_roster(owner, replace(roster, serial=serial, epoch=epoch)))

    def _revoke(self, owner: Ed25519PrivateKey, trust: Trust, key: str) -> None:
        """Revoke `key`, which the caller then removes from the roster.

        If the change is interrupted before the removal, it can be repeated, because the roster
        still has the key. The roster is signed with the current epoch first, so that takeovers
        which the key signs for earlier epochs are not valid.
        """
        self._sign(owner, trust.roster)
        keys = sorted(trust.revoked | {key})
        self._keep("revocation", sign_revocation(owner, trust.revocation + 1, keys))

    def _owner(self) -> Ed25519PrivateKey:
        self._require_site()
        if not self._file(_pem("owner", OWNER)).exists():
            raise SigningError(
                f"{self.path}: the key of the site's owner is not on this machine; run the command "
                "on the owner's machine"
            )
        return self._load("owner", OWNER)

    def _require_site(self) -> None:
        if not self.made:
            raise SigningError(
                f"{self.path}: there are no keys of a site; make them with pa-console keys make"
            )

    def _first(self, kind: str, names: Mapping[str, object]) -> str:
        for name in names:
            if self._file(_pem(kind, name)).exists():
                return name
        people = ", ".join(names) or "none"
        raise SigningError(f"{self.path}: no {kind} in the roster has a key here ({people})")

    def _make(self, kind: str, name: str, passphrase: str = "") -> Ed25519PrivateKey:
        _named(name)
        key = Ed25519PrivateKey.generate()
        secret = passphrase.encode()
        how = form.BestAvailableEncryption(secret) if secret else form.NoEncryption()
        pem = key.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, how)
        replace_private(self._file(_pem(kind, name)), pem)
        return key

    def _load(self, kind: str, name: str) -> Ed25519PrivateKey:
        path = self._file(_pem(kind, name))
        try:
            pem = self._read(path.name)
        except FileNotFoundError as error:
            raise SigningError(f"{path}: the key of {name} is not on this machine") from error
        secret = None
        if b"ENCRYPTED" in pem:
            if self._ask is None:
                raise SigningError(f"{path}: the passphrase of this key cannot be asked for here")
            secret = self._ask(name).encode()
        try:
            key = form.load_pem_private_key(pem, secret)
        except (ValueError, TypeError, UnsupportedAlgorithm) as error:
            problem = "wrong passphrase" if secret is not None else "not a private key in PEM"
            raise SigningError(f"{path}: {problem}") from error
        if not isinstance(key, Ed25519PrivateKey):
            raise SigningError(f"{path}: not an Ed25519 key")
        return key

    def _message(self, name: str) -> str:
        """Return the signed message of the kind `name`; '' if there is none."""
        with suppress(FileNotFoundError):
            return self._read(f"{name}.jwt").decode("ascii", "replace").strip()
        return ""

    def _read(self, name: str) -> bytes:
        path = self._file(name)
        try:
            return read_private(path)
        except FileNotFoundError:
            raise
        except NotPrivateError as error:
            raise SigningError(f"{path}: this key is not used: {error.strerror}") from error
        except OSError as error:
            raise SigningError(f"{path}: cannot be read: {error.strerror or error}") from error

    def _keep(self, name: str, message: str) -> None:
        replace_private(self._file(f"{name}.jwt"), message.encode())

    def _file(self, name: str) -> Path:
        return self.path / name

    @contextmanager
    def _locked(self) -> Generator[None]:
        """Lock the folder while its keys are changed; make it if it does not exist."""
        lock = FileLock(self.path / ".lock", timeout=LOCK_SECONDS, mode=FILE_MODE)
        try:
            make_private_folder(self.path)
            lock.acquire()
        except Timeout as error:
            problem = "another program is changing the keys; try again"
            raise SigningError(f"{self.path}: {problem}") from error
        except OSError as error:
            problem = f"keys cannot be stored there: {error.strerror or error}"
            raise SigningError(f"{self.path}: {problem}") from error
        try:
            yield
        finally:
            lock.release()


def _pem(kind: str, name: str) -> str:
    return "owner.pem" if kind == "owner" else f"{kind}-{name}.pem"


def _named(name: str) -> None:
    if _NAME.fullmatch(name) is None:
        raise ValueError(f"{name!r} is not a name for a key: letters, digits, - and _, at most 64")


def _key_of(name: str, roster: Roster) -> str:
    if name in roster.people:
        return roster.people[name].key
    if name in roster.stations:
        return roster.stations[name]
    holders = ", ".join((*roster.people, *roster.stations))
    raise ValueError(f"there is no person or station {name!r}; known: {holders}")
