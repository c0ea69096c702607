"""What it costs to sign a command at the station, and to check it at the vehicle."""

import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from pa_console.fleets.authorization import (
    Approval,
    EnrolledRules,
    Grounds,
    Memory,
    Person,
    Roster,
    Verifier,
    public_of,
    sign_approval,
    sign_command,
    sign_roster,
    sign_takeover,
    words,
)
from pa_console.schema.command import DeviceCommand
from tests.benchmarks.speed.compare import Bench, Comparison, alternate, compare

PART = "authorization"
SHA256 = "a" * 64
ORDER = DeviceCommand(command_id="M1.1.1", agent="Ugv_T01", verb="move_to", target="EastGate")


class Site:
    """A site with one station and one person, who approves one order after another."""

    def __init__(self) -> None:
        self.owner, self.station, self.person = (Ed25519PrivateKey.generate() for _ in range(3))
        roster = Roster(
            1,
            {"ann": Person(public_of(self.person), "commander")},
            {"north": public_of(self.station)},
            {SHA256: EnrolledRules("bench")},
        )
        self.messages = (
            sign_roster(self.owner, roster),
            sign_takeover(self.person, "ann", 1, public_of(self.station)),
        )

    def verifier(self, memory: Memory | None = None) -> Verifier:
        """Return a vehicle's verifier, told all that the site has signed."""
        made = Verifier(ORDER.agent, public_of(self.owner), memory)
        for message in self.messages:
            made.take(message)
        return made

    def approved(self) -> Iterator[tuple[DeviceCommand, Grounds]]:
        """Yield one approved command after another."""
        station = public_of(self.station)
        for number in count():
            command = ORDER.model_copy(update={"command_id": f"M{number}.1.1"})
            approval = Approval(
                "ann", station, "bench", f"M{number}.1", (words(command),), SHA256, SHA256
            )
            signed = {"ann": sign_approval(self.person, approval, time.time())}
            yield command, Grounds("ann", "bench", SHA256, SHA256, "operator", 1, signed)


def measure_authorization(bench: Bench) -> list[Comparison]:
    """Time signing and checking; the limit is that of the bare signatures.

    Raises ValueError when a command is refused.
    """
    site = Site()
    with tempfile.TemporaryDirectory() as folder:
        memory = Memory(Path(folder) / "memory")
        bench.tell("approving, signing, checking", 0.2)
        approvals, one = site.approved(), next(site.approved())
        payload = _token(site, *one).encode()
        signature = site.station.sign(payload)
        key = site.station.public_key()
        approving, signing, checking, on_disk, bare = alternate(
            bench.runs,
            (
                lambda: next(approvals),
                lambda: _token(site, *one),
                _checked(site, site.verifier()),
                _checked(site, site.verifier(memory)),
                lambda: (
                    site.station.sign(payload),
                    key.verify(signature, payload),
                    key.verify(signature, payload),
                ),
            ),
        )
        memory.close()
    # what is timed with a check is an approval and a token of its own besides
    before = [one + other for one, other in zip(approving, signing, strict=True)]
    check = [max(all_ - less, 0.0) for all_, less in zip(checking, before, strict=True)]
    disk = [max(all_ - less, 0.0) for all_, less in zip(on_disk, before, strict=True)]
    both = [one + other for one, other in zip(signing, check, strict=True)]
    limit = ("limit: one bare Ed25519 signature, two checked", bare)
    return [
        compare(PART, "sign and check a command", ("station and vehicle", both), limit),
        compare(PART, "sign an approval", ("by a person, once a plan", approving)),
        compare(PART, "sign a command", ("by the station", signing)),
        compare(PART, "check a command", ("token and one approval", check)),
        compare(PART, "check a command, noted on the disk", ("survives a power cut", disk)),
    ]


def _token(site: Site, command: DeviceCommand, grounds: Grounds) -> str:
    return sign_command(site.station, command, grounds, time.time())


def _checked(site: Site, verifier: Verifier) -> Callable[[], None]:
    """Return what approves, signs and checks one more command."""
    approved = site.approved()

    def check() -> None:
        command, grounds = next(approved)
        if why := verifier.verify(_token(site, command, grounds), command):
            raise ValueError(f"a command was refused: {why}")

    return check
