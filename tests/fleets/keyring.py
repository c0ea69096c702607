"""A site with its keys: an owner, two stations, four people, and what vehicles are told of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from pa_console.fleets import authorization as auth
from pa_console.schema.command import DeviceCommand

NOW = 1_800_000_000.0
RULES = "a" * 64
PLAN = "b" * 64
HEAD = "c" * 64
NAMES = ("owner", "north", "south", "lost", "ann", "bob", "cleo", "otto", "gone", "eve")
KEYS = {
    name: Ed25519PrivateKey.from_private_bytes(bytes([number]) * 32)
    for number, name in enumerate(NAMES, start=1)
}
PUBLIC = {name: auth.public_of(key) for name, key in KEYS.items()}
ROSTER = auth.Roster(
    serial=1,
    people={
        "ann": auth.Person(PUBLIC["ann"], "operator"),
        "bob": auth.Person(PUBLIC["bob"], "operator"),
        "cleo": auth.Person(PUBLIC["cleo"], "commander"),
        "otto": auth.Person(PUBLIC["otto"], "observer"),
        "gone": auth.Person(PUBLIC["gone"], "operator"),
    },
    stations={name: PUBLIC[name] for name in ("north", "south", "lost")},
    rules={RULES: auth.EnrolledRules("checkpoint", {"block": 2, "override": 2, "first_order": 1})},
)
SIGNED_ROSTER = auth.sign_roster(KEYS["owner"], ROSTER)
REVOCATION = auth.sign_revocation(KEYS["owner"], 1, [PUBLIC["gone"], PUBLIC["lost"]])
TO_NORTH = auth.sign_takeover(KEYS["cleo"], "cleo", 1, PUBLIC["north"])
TO_SOUTH = auth.sign_takeover(KEYS["cleo"], "cleo", 2, PUBLIC["south"])


@dataclass
class Clock:
    """A clock that is set by hand."""

    at: float = NOW

    def __call__(self) -> float:
        """Return the seconds since 1970."""
        return self.at


@dataclass
class Vehicle:
    """A vehicle that carries out what its verifier lets pass; `told` is what it is told first."""

    serial: str = "Ugv_T01"
    clock: Clock = field(default_factory=Clock)
    memory: auth.Memory = field(default_factory=auth.Memory)
    told: Sequence[str] = (SIGNED_ROSTER, REVOCATION, TO_NORTH)
    carried_out: list[DeviceCommand] = field(default_factory=list[DeviceCommand])

    def __post_init__(self) -> None:
        self.verifier = auth.Verifier(self.serial, PUBLIC["owner"], self.memory, self.clock)
        for message in self.told:
            assert self.verifier.take(message) == ""

    def get(self, token: str | None, command: DeviceCommand) -> str:
        """Take `command` in; return why it is refused, '' when it was carried out."""
        why = self.verifier.verify(token, command)
        if not why:
            self.carried_out.append(command)
        return why


def order(
    verb: str = "move_to", target: str | None = "EastGate", number: int = 1, agent: str = "Ugv_T01"
) -> DeviceCommand:
    return DeviceCommand.model_validate(
        {"command_id": f"M1.1.{number}", "agent": agent, "verb": verb, "target": target}
    )


def approval_of(
    person: str,
    *orders: str,
    station: str = "north",
    key: str = "",
    now: float = NOW,
    **said: object,
) -> str:
    """The signature of `person`, by default with the own key, under `orders`."""
    given = auth.Approval(person, PUBLIC[station], "S", "M1.1", orders, PLAN, RULES)
    return auth.sign_approval(KEYS[key or person], replace(given, **said), now)  # pyright: ignore[reportArgumentType]


def token_of(
    command: DeviceCommand,
    by: Sequence[str] = ("ann",),
    *,
    station: str = "north",
    key: str = "",
    epoch: int = 1,
    now: float = NOW,
    approvals: dict[str, str] | None = None,
    serial: str = "",
    kind: auth.Kind = "operator",
    acts: tuple[str, ...] = (),
) -> str:
    """The token of `station` for `command`, which the people `by` have approved."""
    if approvals is None:
        said = auth.words(command)
        approvals = {
            name: approval_of(name, said, station=station, now=now, kind=kind, acts=acts)
            for name in by
        }
    grounds = auth.Grounds(by[0], "S", PLAN, RULES, kind, epoch, approvals)
    return auth.sign_command(KEYS[key or station], command, grounds, now, head=HEAD, serial=serial)
