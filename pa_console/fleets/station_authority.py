"""The signing of approvals and commands with the keys of a station and of the person at it."""

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from pa_console.fleets.authorization import (
    Approval,
    Grounds,
    Records,
    RefusedError,
    SignedMessages,
    Trust,
    UnsignedApproval,
    Verifier,
    public_of,
    sign_approval,
    sign_command,
    sign_records,
    sign_takeover,
    words,
)
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.mission import Decision

MOST_SENT = 512
"""The number of recent commands that can be signed again when they are sent again."""


@dataclass(frozen=True)
class Keys:
    """The keys of a station and of the person at it."""

    station: Ed25519PrivateKey
    """The station's private key."""
    person: str
    """The name of the person at the station."""
    own: Ed25519PrivateKey
    """The person's private key."""
    owner: str
    """The public key of the site's owner, in hexadecimal."""
    messages: tuple[str, ...]
    """The newest signed roster, revocation and takeover, which vehicles follow."""


class StationAuthority:
    """The signer for a station and the person at it, within their rights in the site's roster.

    A fleet calls `authorize` for the token of a command. `take` receives another station's
    takeover; after it, this station signs no commands.
    """

    def __init__(
        self,
        keys: Keys,
        commanded: Iterable[str] = (),
        keep: Callable[[str], object] = lambda _message: None,
    ) -> None:
        """Sign with `keys`; `commanded` are the vehicles that had an order in earlier sessions.

        `keep` is called with every signed message that is accepted later. Raises ValueError if the
        site's roster is not valid.
        """
        self.keys, self._public = keys, public_of(keys.station)
        self.trust = Trust(keys.owner)
        self._signed, self._keep = SignedMessages(self.trust.take), keep
        problems = [why for message in keys.messages if (why := self._signed.hear(message))]
        if not self.trust.roster.serial:
            why = "; ".join(problems) or "there is none"
            raise ValueError(f"the roster of this site is not valid: {why}")
        self._commanded = set(commanded)
        self._plan: tuple[frozenset[str], Grounds] | None = None
        self._sent: OrderedDict[str, Grounds] = OrderedDict()
        self._session, self._head = "", str
        self.now: Callable[[], float] = _no_time
        """The vehicles' clock, in seconds since 1970."""

    @property
    def person(self) -> str:
        """The name of the person at this station."""
        return self.keys.person

    def begin(self, session: str, head: Callable[[], str], now: Callable[[], float]) -> None:
        """Sign for `session` from now on.

        `head` returns the head of its log, and `now` the time on the vehicles' clock, in seconds
        since 1970.
        """
        self._session, self._head, self.now = session, head, now
        self._plan = None
        self._sent.clear()

    def take(self, message: str) -> str:
        """Accept a signed roster, revocation or takeover; return the reason if refused, else ''."""
        before = set(self._signed.newest.values())
        why = self._signed.hear(message)
        for taken in self._signed.newest.values():
            if taken not in before:
                self._keep(taken)
        return why

    def take_command(self, commander: str, key: Ed25519PrivateKey) -> None:
        """Put this station in command, signed with the `key` of `commander`.

        The takeover is then in `newest`; its receivers no longer accept commands from another
        station. Raises ValueError, and changes nothing, if the takeover is not valid.
        """
        if not self.name:
            raise ValueError("this station is not in the roster: the owner of the site enrols it")
        message = sign_takeover(key, commander, self.trust.next_epoch, self._public)
        if why := self.take(message):
            raise ValueError(f"{self.name} cannot take command: {why}")

    @property
    def newest(self) -> Mapping[str, str]:
        """The newest signed message of each kind, which vehicles follow."""
        return self._signed.newest

    @property
    def refusal(self) -> str:
        """The reason why this station may not command any vehicle now; '' if it may."""
        trust = self.trust
        if trust.takeover.station != self._public:
            return f"this station is not in command: {trust.in_command}"
        if self._public in trust.revoked:
            return "the key of this station was revoked"
        if not trust.roster.station_of(self._public):
            return "this station is not in the roster"
        return ""

    def objection(self, rules: Rulebook) -> str:
        """Return why vehicles would refuse plans checked against `rules`; '' if they would not."""
        if rules.seal.content_sha256 in self.trust.roster.rules:
            return ""
        return (
            f"no vehicle accepts a plan that was checked against the rules {rules.name!r}: enrol "
            "them with pa-console keys enrol rules FILE"
        )

    def objection_to(self, request_id: str, person: str, signature: str) -> str:
        """Return why another station's signature cannot count for a request here; '' if it can.

        This does not compare the plan; `valid` does.
        """
        try:
            approval, _ = self.trust.approval(person, signature, self.now())
            given = [approval[part] for part in ("station", "session", "request")]
        except RefusedError as refused:
            return str(refused)
        except (ValueError, KeyError, TypeError) as error:
            return f"it cannot be read: {error}"
        if given != [self._public, self._session, request_id]:
            return f"{person} has signed something else"
        return ""

    def to_sign(self, request: ApprovalRequested, rules: Rulebook, person: str) -> UnsignedApproval:
        """Return the approval of `request` for `person` to sign at another station."""
        return UnsignedApproval.of(self._approval_by(person, request, rules), self.now())

    def objection_to_signature(
        self, request: ApprovalRequested, rules: Rulebook, person: str, signature: str
    ) -> str:
        """Return why another station's signature does not approve `request`; '' if it does.

        The gate checks that the signature is not repeated.
        """
        if why := self.objection_to(request.request_id, person, signature):
            return why
        approval, _ = self.trust.approval(person, signature, self.now())
        try:
            return _difference(self._approval_by(person, request, rules), approval)
        except (KeyError, TypeError) as error:
            return f"it cannot be read: {error}"

    def vouch(self, records: Records) -> str:
        """Return this station's signature of shared `records` of its log."""
        return sign_records(self.keys.station, records, self.now())

    @property
    def name(self) -> str:
        """The name of this station in the roster; '' if it is not in the roster."""
        return self.trust.roster.station_of(self._public)

    def fresh(self, agents: Collection[str]) -> frozenset[str]:
        """Return the agents that have never had an order."""
        return frozenset(agents) - self._commanded

    def signed(self, request: ApprovalRequested, decision: Decision, rules: Rulebook) -> Decision:
        """Return `decision` with the signature of the person at this station."""
        approval = self._approval(request, decision, rules)
        signature = sign_approval(self.keys.own, approval, self.now())
        return decision.model_copy(update={"signatures": {self.keys.person: signature}})

    def valid(
        self, request: ApprovalRequested, decision: Decision, rules: Rulebook
    ) -> dict[str, str]:
        """Return the signatures of `decision` that approve `request`, at most one for each key.

        Signatures for other orders, or by people who may not approve, are left out.
        """
        wanted = self._approval(request, decision, rules)
        valid, keys = dict[str, str](), set[str]()
        for name, signature in decision.signatures.items():
            try:
                approval, key = self.trust.approval(name, signature, self.now())
                different = _difference(wanted, approval)
            except (RefusedError, ValueError, KeyError, TypeError):
                continue
            if not different and key not in keys:
                keys.add(key)
                valid[name] = signature
        return valid

    def grant(self, request: ApprovalRequested, decision: Decision, rules: Rulebook) -> None:
        """Allow the commands of an approved plan and of its way to safety to be signed."""
        approval = self._approval(request, decision, rules)
        approvals, by = self.valid(request, decision, rules), self.keys.person
        grounds = Grounds(
            operator=by if by in approvals else next(iter(approvals), ""),
            session=self._session,
            plan=approval.plan,
            rules=approval.rules,
            kind=approval.kind,
            epoch=self.trust.takeover.epoch,
            approvals=approvals,
        )
        self._plan = frozenset(approval.orders), grounds

    def authorize(self, command: DeviceCommand) -> str | None:
        """Return the token of `command`; None for a hold or a command without approval.

        None is also returned if this station may not command any vehicle.
        """
        if command.verb == "hold" or self.refusal:
            return None
        grounds = self._sent.get(command.command_id)
        if grounds is None:
            orders, grounds = self._plan or (frozenset[str](), None)
            if grounds is None or words(command) not in orders:
                return None
            self._sent[command.command_id] = grounds
            self._commanded.add(command.agent)
            if len(self._sent) > MOST_SENT:
                self._sent.popitem(last=False)
        return sign_command(self.keys.station, command, grounds, self.now(), head=self._head())

    def _approval(
        self, request: ApprovalRequested, decision: Decision, rules: Rulebook
    ) -> Approval:
        """Return the approval of `request` that the person here gives with `decision`."""
        approval = self._approval_by(self.keys.person, request, rules)
        return replace(approval, kind="standing") if decision.standing else approval

    def _approval_by(self, person: str, request: ApprovalRequested, rules: Rulebook) -> Approval:
        return approval_of(
            request,
            person=person,
            station=self._public,
            session=self._session,
            rules=rules.seal.content_sha256,
        )


def approval_of(
    request: ApprovalRequested, *, person: str, station: str, session: str, rules: str
) -> Approval:
    """Return the approval by `person` of a `request` from the station with the given public key.

    `rules` is the SHA-256 of the rule set against which the plan was checked.
    """
    acts = {"override": request.needs_override, "acknowledge": bool(request.acknowledge)}
    actions = chain(request.plan.actions, request.if_halted)
    return Approval(
        person=person,
        station=station,
        session=session,
        request=request.request_id,
        orders=tuple(f"{action.agent} {action.command}" for action in actions),
        plan=hashlib.sha256(request.plan.answer.encode()).hexdigest(),
        rules=rules,
        kind="override" if request.needs_override else "operator",
        acts=tuple(act for act, asked in acts.items() if asked),
    )


def _difference(wanted: Approval, approval: Mapping[str, Any]) -> str:
    """Return how a signed `approval` differs from `wanted`, in words; '' if it does not."""
    for part in ("station", "session", "request", "plan", "rules"):
        if approval[part] != getattr(wanted, part):
            return f"{approval['person']} has signed another {part}"
    if tuple(approval["orders"]) != wanted.orders:
        return f"{approval['person']} has signed other orders"
    if left := [act for act in wanted.acts if act not in approval["acts"]]:
        return f"{approval['person']} has not signed this: {', '.join(left)}"
    return ""


class Vehicles:
    """The verifiers of a simulation's vehicles, one for each vehicle."""

    def __init__(
        self, agents: Iterable[str], owner: str, messages: Iterable[str], now: Callable[[], float]
    ) -> None:
        """Make a verifier for each of `agents`, all with the clock `now`.

        `owner` is the public key of the site's owner. `messages` are the signed messages that the
        vehicles receive first.
        """
        self._verifiers = {agent: Verifier(agent, owner, now=now) for agent in agents}
        self._signed = SignedMessages(self._tell)
        for message in messages:
            self.take(message)

    @property
    def in_command(self) -> str:
        """A sentence that names the station in command, which the vehicles follow."""
        first = next(iter(self._verifiers.values()), None)
        return first.trust.in_command if first is not None else "there is no vehicle"

    def take(self, message: str) -> str:
        """Pass a signed message to every vehicle; return why one refuses it; '' if none does."""
        return self._signed.hear(message)

    def _tell(self, message: str) -> str:
        refusals = [verifier.take(message) for verifier in self._verifiers.values()]
        return next(filter(None, refusals), "")

    def verify(self, token: str | None, command: DeviceCommand) -> str:
        """Return why the command's agent refuses it with the given token; '' if it accepts it."""
        return self._verifiers[command.agent].verify(token, command)


def _no_time() -> float:
    raise RuntimeError("nothing is signed before a session begins")
