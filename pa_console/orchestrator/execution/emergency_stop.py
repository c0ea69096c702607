"""Commands that bring assets to a stop: sent at once, and again until every device has answered."""

from collections.abc import Iterator, Sequence
from math import inf

from pa_console.fleets.fleet import Fleet
from pa_console.orchestrator.execution.command_gate import CommandGate
from pa_console.orchestrator.execution.dispatch import Dispatch
from pa_console.orchestrator.execution.step_feed import Step
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev

SAFETY_LIMIT_S = 60.0
"""A way to safety is told again for so long to whoever has not answered."""


class EmergencyStop:
    """Follows stop commands that no mission follows any more."""

    def __init__(self, fleet: Fleet, gate: CommandGate) -> None:
        self._fleet, self._gate = fleet, gate
        self._open: list[Dispatch] = []

    @property
    def waiting(self) -> bool:
        """Whether a device has not answered yet."""
        return bool(self._open)

    def hold_all(self) -> list[ev.EventPayload]:
        """Stop everything and tell every asset to hold, whatever is known of it; return the events.

        A hold is sent again until its device has answered or gets another command, however long
        that takes: nothing but a device's own word ends a stop.
        """
        self._open.clear()
        return list(self._follow(self._gate.stop_all(), inf))

    def follow(self, commands: Sequence[DeviceCommand]) -> Iterator[ev.EventPayload]:
        """Send a mission's way to safety and see to the answers from now on; yield the events."""
        return self._follow(commands, SAFETY_LIMIT_S)

    def step(self, step: Step) -> Iterator[ev.EventPayload]:
        """Take in one step's replies; send again what was not answered and still stands."""
        tick, replies = step
        for stop in self._open:
            for reply in stop.advance(tick, replies):
                yield ev.CommandReplied(reply=reply)
            for command, times in stop.resends(tick):
                resent = self._gate.resend(command, times)
                if resent is not None:
                    yield resent
                else:
                    stop.forget(command)
        self._open = [stop for stop in self._open if not stop.finished]

    def _follow(
        self, commands: Sequence[DeviceCommand], limit_s: float
    ) -> Iterator[ev.EventPayload]:
        told = [self._gate.send(command) for command in commands]
        yield from told
        sent = [payload.command for payload in told if isinstance(payload, ev.CommandSent)]
        if sent:
            self._open.append(
                Dispatch(sent, self._fleet.tick, self._fleet.world.dt_s, limit_s, limit_s)
            )
