"""The messages that a vehicle or a station trusts: roster, revoked keys, station in command."""

from collections.abc import Callable
from dataclasses import dataclass

from pa_console.fleets.authorization.messages import (
    APPROVAL_S,
    RECORDS_S,
    ROLES,
    Claims,
    Message,
    Person,
    Records,
    RefusedError,
    Roster,
    check_time,
    kind_of,
    open_message,
    public_key,
    unverified,
    whole_number,
)

KINDS_OF_TRUST: tuple[Message, ...] = ("roster", "revocation", "takeover")
"""The kinds of messages that change the trust of a vehicle or a station."""

MOST_REFUSED = 16
"""The largest number of refused messages that are kept and tried again."""


@dataclass(frozen=True)
class Takeover:
    """The station in command, by its public key, and the epoch that a commander signed for it."""

    epoch: int = 0
    station: str = ""
    person: str = ""


class Trust:
    """The trust of a vehicle or a station: roster, revoked keys, station in command.

    Trust starts with the public key of the site's owner. Signed messages update it, each only if
    it is newer than the one before.
    """

    def __init__(self, owner: str) -> None:
        """Trust `owner`, a public key of 32 bytes in hexadecimal; raises ValueError if invalid."""
        self._owner = public_key(owner)
        self.roster = Roster()
        self.revoked: frozenset[str] = frozenset()
        self.revocation = 0
        """The serial of the last revocation."""
        self.takeover = Takeover()

    @property
    def in_command(self) -> str:
        """A sentence that names the station in command and its epoch."""
        if not self.takeover.epoch:
            return "no station is in command: a commander has to sign for one"
        name = self.roster.station_of(self.takeover.station) or "a station that is not enrolled"
        return f"{name} is in command since epoch {self.takeover.epoch}"

    @property
    def next_epoch(self) -> int:
        """The epoch of the next takeover."""
        return max(self.takeover.epoch, self.roster.epoch) + 1

    def take(self, message: str) -> str:
        """Accept a signed roster, revocation or takeover; return the reason if refused, else ''.

        A repeated message is accepted and changes nothing. If two commanders independently sign
        takeovers with the same epoch, the station with the higher key is in command, so that every
        receiver of both messages follows the same station.
        """
        try:
            match kind_of(message):
                case "roster":
                    self._take_roster(open_message(message, "roster", self._owner))
                case "revocation":
                    self._take_revocation(open_message(message, "revocation", self._owner))
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
        """Return the person called `name`; raises RefusedError if unknown or revoked."""
        person = self.roster.people.get(name)
        if person is None:
            raise RefusedError(f"{name!r} is not in the roster")
        if person.key in self.revoked:
            raise RefusedError(f"the key of {name} was revoked")
        return person

    def approver(self, name: str) -> Person:
        """Return the person called `name`; raises RefusedError if that person may not approve."""
        person = self.person(name)
        if ROLES.index(person.role) < ROLES.index("operator"):
            raise RefusedError(f"{name} has the role {person.role}, which may not approve")
        return person

    def approval(self, name: str, message: str, now: float) -> tuple[Claims, str]:
        """Return the claims of the approval by the person called `name`, and the person's key.

        Raises RefusedError if the person may not approve or did not sign `message`, or if the
        approval is not valid at `now`.
        """
        person, subject = self.approver(name), f"the approval of {name}"
        approval = open_message(message, "approval", public_key(person.key), subject)
        check_time(approval, subject, APPROVAL_S, now)
        if approval["person"] != name or type(approval["orders"]) is not list:
            raise RefusedError(f"{subject} is not a valid approval")
        return approval, person.key

    def records(self, station: str, message: str, now: float) -> Records:
        """Return the records that the station called `station` confirms by its signature.

        Raises RefusedError if the station did not sign `message`, or if the signature is not valid
        at `now`.
        """
        key, subject = self.roster.stations.get(station), f"the signature of {station}"
        if key is None or key in self.revoked:
            raise RefusedError(f"{station} is not a station of this site")
        try:
            claims = open_message(message, "records", public_key(key), subject)
            check_time(claims, subject, RECORDS_S, now)
            first, last = whole_number(claims["first"]), whole_number(claims["last"])
            return Records(str(claims["session"]), first, last, str(claims["head"]))
        except (ValueError, KeyError, TypeError) as error:
            raise RefusedError(f"{subject} is not valid: {error}") from error

    def _take_roster(self, claims: Claims) -> None:
        roster = Roster.of(claims)
        if roster.serial < self.roster.serial or (
            roster.serial == self.roster.serial and roster != self.roster
        ):
            raise RefusedError(f"roster {roster.serial} is not newer than {self.roster.serial}")
        self.roster = roster

    def _take_revocation(self, claims: Claims) -> None:
        serial, keys = whole_number(claims["serial"]), frozenset[str](claims["keys"])
        if serial < self.revocation or (serial == self.revocation and keys != self.revoked):
            raise RefusedError(f"revocation {serial} is not newer than {self.revocation}")
        if not keys >= self.revoked:
            raise RefusedError("a revoked key stays revoked")
        self.revocation, self.revoked = serial, keys

    def _take_takeover(self, message: str) -> None:
        claimed = unverified(message)
        name = str(claimed.get("person"))
        person = self.person(name)
        if person.role != "commander":
            raise RefusedError(f"{name} has the role {person.role}; only commanders give command")
        claims = open_message(message, "takeover", public_key(person.key))
        taken = Takeover(whole_number(claims["epoch"]), str(claims["station"]), name)
        if taken.epoch < self.roster.epoch:
            raise RefusedError(f"epoch {taken.epoch} is over: the roster has {self.roster.epoch}")
        if taken.epoch == self.takeover.epoch and taken.station == self.takeover.station:
            return
        now = self.takeover
        if (taken.epoch, taken.station) < (now.epoch, now.station):
            raise RefusedError(f"epoch {taken.epoch} is not newer; {self.in_command}")
        self.takeover = taken


class SignedMessages:
    """A receiver of signed messages that may arrive in any order, as from a bus that retains them.

    A takeover may arrive before the roster that names its commander. Therefore, the last
    MOST_REFUSED refused messages are tried again whenever another message is accepted.
    """

    def __init__(self, take: Callable[[str], str]) -> None:
        """Pass messages to `take`, which accepts a message or returns the reason for a refusal."""
        self._take = take
        self.newest: dict[str, str] = {}
        """The last accepted message of each kind."""
        self._refused: dict[str, str] = {}
        """The recently refused messages, each with its kind."""

    def hear(self, message: str) -> str:
        """Accept `message` if it is newer than the last one; return the reason if refused.

        The result is '' if the message is accepted or already known.
        """
        try:
            kind = kind_of(message)
        except Exception as error:
            return f"it cannot be read: {error}"
        if self.newest.get(kind) == message:
            return ""
        if why := self._take(message):
            if kind in KINDS_OF_TRUST:
                self._refused[message] = kind
            if len(self._refused) > MOST_REFUSED:
                del self._refused[next(iter(self._refused))]
            return why
        self.newest[kind] = message
        self._try_again()
        return ""

    def _try_again(self) -> None:
        for message, kind in tuple(self._refused.items()):
            if not self._take(message):
                del self._refused[message]
                self.newest[kind] = message
                self._try_again()
                return
