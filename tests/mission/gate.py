"""One command at the gate, for tests that look at each by itself."""

from pa_console.mission.gate import CommandGate, Passage
from pa_console.schema.command import DeviceCommand


def send(gate: CommandGate, command: DeviceCommand) -> Passage:
    """Put one command to the gate; return what became of it."""
    return gate.send((command,), lambda _: None)[-1]
