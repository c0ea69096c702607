"""The gate on a link that notes what is put on it, one command at a time."""

from dataclasses import dataclass, field

from pa_console.mission.gate import CommandGate, Passage
from pa_console.schema.command import DeviceCommand
from pa_console.session.log.journal import Journal
from tests.shipped import home

WORLD = home()


@dataclass
class Link:
    """What is put on the link, in place of a fleet, and who the picture shows as taken."""

    world = WORLD
    sent: list[DeviceCommand] = field(default_factory=list[DeviceCommand])
    marked: frozenset[str] = frozenset()

    def send(self, command: DeviceCommand) -> None:
        """Note the command."""
        self.sent.append(command)

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Note whom the picture is to show."""
        self.marked = assets


def gate_on(link: Link, journal: Journal | None = None) -> CommandGate:
    """Return a gate on the link that writes its log nowhere."""
    return CommandGate(link, journal or Journal())  # pyright: ignore[reportArgumentType]


def send(gate: CommandGate, command: DeviceCommand) -> Passage:
    """Put one command to the gate; return what became of it."""
    return gate.send((command,), lambda _: None)[-1]
