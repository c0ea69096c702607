"""The `Verifier` of a vehicle, which decides whether a command may be carried out; its `Memory`."""

import json
import sqlite3
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Literal

import jwt

from pa_console.fleets.authorization.messages import (
    MOST_USED,
    TOKEN_S,
    UNSIGNED,
    Claims,
    Command,
    RefusedError,
    Roster,
    check_time,
    digest,
    open_message,
    public_key,
    unverified,
    whole_number,
    words,
)
from pa_console.fleets.authorization.trust import Takeover, Trust

_ONE_APPROVAL = ("person", "station", "session", "request", "nbf")
_USED = {"used": "used before", "forgotten": "made before any that this vehicle remembers"}


class Memory:
    """The used tokens and the newest signed messages of a vehicle.

    With a `path`, the memory survives a restart and a power cut: a token is on the disk before its
    command is carried out. Raises OSError or sqlite3.Error if the file cannot be used.
    """

    def __init__(self, path: Path | None = None, most: int = MOST_USED) -> None:
        """Keep the last `most` entries of each kind."""
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
        """Record the use of `name`, which expires at `until`, and return ''.

        Returns "used" if `name` was used before. Returns "forgotten" if `name` expires no later
        than an entry that was deleted, because `name` may have been deleted as well.
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
        """Return the value stored under `name`; '' if there is none."""
        row = self._base.execute("SELECT value FROM kept WHERE name = ?", (name,)).fetchone()
        return str(row[0]) if row is not None else ""

    def keep(self, name: str, value: str) -> None:
        """Store `value` under `name` in place of any earlier value."""
        with self._base:
            self._base.execute("INSERT OR REPLACE INTO kept VALUES (?, ?)", (name, value))

    def close(self) -> None:
        """Close the file."""
        self._base.close()

    def _forget(self, kind: str) -> None:
        """Delete the half of the entries that expires first, and record its latest expiry.

        From then on, `use` returns "forgotten" for every name that expires by that time.
        """
        query = "SELECT until FROM used WHERE kind = ? ORDER BY until LIMIT 1 OFFSET ?"
        row = self._base.execute(query, (kind, self._count[kind] // 2)).fetchone()
        query = "DELETE FROM used WHERE kind = ? AND until <= ?"
        self._count[kind] -= self._base.execute(query, (kind, row[0])).rowcount
        horizon = (f"{kind} horizon", repr(float(row[0])))
        self._base.execute("INSERT OR REPLACE INTO kept VALUES (?, ?)", horizon)


class Verifier:
    """The check at one vehicle that decides whether a command may be carried out.

    If anything goes wrong, the command is refused. A vehicle does not verify a command id that it
    already has; it repeats its last answer.
    """

    def __init__(
        self,
        serial: str,
        owner: str,
        memory: Memory | None = None,
        now: Callable[[], float] = time.time,
    ) -> None:
        """Verify commands to the vehicle with the serial number `serial`.

        `owner` is the public key of the site's owner, and `now` is the vehicle's clock. Raises
        ValueError if `memory` belongs to a vehicle of another owner.
        """
        self.serial, self.trust, self._now = serial, Trust(owner), now
        self._memory = memory if memory is not None else Memory()
        self._fresh = not self._memory.kept("commanded")
        if (kept := self._memory.kept("owner")) not in ("", owner):
            raise ValueError(f"this memory belongs to a vehicle of the owner {kept}")
        self._memory.keep("owner", owner)
        self._recall()

    def take(self, message: str) -> str:
        """Accept a signed roster, revocation or takeover; return the reason if refused, else ''.

        If the memory cannot store an accepted message, the error is returned instead.
        """
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
                return f"it is valid only until a restart, because it cannot be stored: {error}"
        return why

    def verify(self, token: str | None, command: Command) -> str:
        """Return why `command` is refused; '' if it may be carried out once, now.

        In that case, the token and one order of each approval are used up.
        """
        try:
            if command.verb in UNSIGNED:
                return ""
            if not token:
                raise RefusedError("it has no authorization")
            claims = self._opened(token)
            self._check_command(claims, command)
            check_time(claims, "its authorization", TOKEN_S, self._now())
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
        """Restore the stored trust after a restart; its messages were verified on arrival."""
        if not (kept := self._memory.kept("trust")):
            return
        state, trust = json.loads(kept), self.trust
        trust.roster = Roster.of(state["roster"])
        trust.revocation, trust.revoked = state["revoked"][0], frozenset(state["revoked"][1])
        trust.takeover = Takeover(**state["takeover"])

    def _opened(self, token: str) -> Claims:
        """Return the claims of `token`.

        Raises RefusedError unless the station in command signed `token` in the current epoch.
        """
        trust = self.trust
        station = trust.takeover.station
        if not trust.takeover.epoch:
            raise RefusedError(trust.in_command)
        if station in trust.revoked:
            raise RefusedError("the key of the station in command was revoked")
        if not trust.roster.station_of(station):
            raise RefusedError("the station in command is no longer enrolled")
        try:
            claims = open_message(token, "command", public_key(station))
        except RefusedError:
            with suppress(jwt.InvalidTokenError, ValueError, TypeError):
                self._explain(token)
            raise
        if claims["iss"] != station:
            raise RefusedError("its authorization does not name the key that signed it")
        epoch = whole_number(claims["epoch"])
        if epoch < trust.takeover.epoch:
            raise RefusedError(f"its authorization is of epoch {epoch}; {trust.in_command}")
        if epoch > trust.takeover.epoch:
            raise RefusedError(f"this vehicle does not know epoch {epoch}; {trust.in_command}")
        return claims

    def _explain(self, token: str) -> None:
        """Raise RefusedError with a better reason if another enrolled station signed `token`."""
        claimed = str(unverified(token).get("iss"))
        name = self.trust.roster.station_of(claimed)
        if name and claimed != self.trust.takeover.station:
            epoch = whole_number(open_message(token, "command", public_key(claimed))["epoch"])
            raise RefusedError(f"{name} signed it in epoch {epoch}; {self.trust.in_command}")

    def _check_command(self, claims: Claims, command: Command) -> None:
        if claims["aud"] != self.serial:
            raise RefusedError(f"its authorization is for {claims['aud']}, not for {self.serial}")
        if claims["jti"] != command.command_id or claims["command"] != digest(command):
            raise RefusedError("its authorization is for another command")

    def _check_approvals(self, claims: Claims, command: Command) -> list[Claims]:
        """Return the approvals in `claims`.

        Raises RefusedError unless each act is approved by as many people as the rules require.
        """
        rules = self.trust.roster.rules.get(claims["rules"])
        if rules is None:
            raise RefusedError(f"the rule set {claims['rules'][:12]} is not enrolled")
        signers: dict[str, set[str]] = {command.verb: set()}
        approvals: list[Claims] = []
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
                raise RefusedError(f"{act} needs {asked} approvals, but it has {len(keys)}")
        return approvals

    def _use(self, claims: Claims, approvals: Sequence[Claims], command: Command) -> None:
        """Use up the token and, from each approval, one order with the words of `command`.

        Therefore, a stolen station key cannot repeat a command that people approved once. Raises
        RefusedError if the token or all such orders were used before.
        """
        token = f"{claims['iss']}/{claims['session']}/{claims['jti']}"
        if why := self._memory.use("token", token, claims["exp"]):
            raise RefusedError(f"its authorization was {_USED[why]}")
        text = words(command)
        for approval in approvals:
            order = json.dumps([approval[part] for part in _ONE_APPROVAL] + [text])
            for number in range(approval["orders"].count(text)):
                why = self._memory.use("order", f"{order}/{number}", approval["exp"])
                if why != "used":
                    break
            if why:
                raise RefusedError(f"the order that {approval['person']} approved was {_USED[why]}")

    def _opened_approval(
        self, name: str, message: str, token: Claims, command: Command
    ) -> tuple[Claims, str]:
        """Return the approval by the person called `name`, and the key that signed it.

        Raises RefusedError if the approval does not cover this command of this station.
        """
        subject = f"the approval of {name}"
        approval, key = self.trust.approval(name, message, self._now())
        if approval["station"] != token["iss"]:
            raise RefusedError(f"{subject} was not given to this station")
        if any(approval[part] != token[part] for part in ("session", "plan", "rules")):
            raise RefusedError(f"{subject} is for another plan or another rule set")
        if words(command) not in approval["orders"]:
            raise RefusedError(f"{subject} is not for {words(command)}")
        return approval, key
