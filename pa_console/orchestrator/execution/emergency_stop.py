"""Commands that bring assets to a stop: sent at once, and again until each is known to stand."""

from collections.abc import Iterator, Mapping, Sequence

from pa_console.fleets.fleet import Fleet
from pa_console.orchestrator.execution.command_gate import CommandGate
from pa_console.orchestrator.execution.dispatch import Dispatch
from pa_console.orchestrator.execution.step_feed import Step
from pa_console.orchestrator.execution.stop_confirmation import StopConfirmation
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.events import event as ev

SAFETY_LIMIT_S = 60.0
"""A way to safety is repeated for this long to assets that have not answered, seconds."""


class EmergencyStop:
    """Follows stop commands that no mission follows any more."""

    def __init__(self, fleet: Fleet, gate: CommandGate) -> None:
        self._fleet, self._gate = fleet, gate
        self._open: list[Dispatch] = []
        self._stop: StopConfirmation | None = None
        self._overdue: Mapping[str, str] = {}

    @property
    def waiting(self) -> bool:
        """True while a way to safety is unanswered, or an asset is not seen to stand."""
        return bool(self._open) or (self._stop is not None and not self._stop.confirmed)

    def hold_all(self) -> list[ev.EventPayload]:
        """Stop everything: send every asset a hold, whatever is known of it; return the events.

        A hold is sent again until telemetry shows that its asset stands, however long that takes,
        and whenever an asset moves again before `release`.
        """
        self._open.clear()
        holds = self._gate.stop_all()
        events: list[ev.EventPayload] = []
        self._gate.send(holds, events.append)
        fleet = self._fleet
        self._stop = StopConfirmation(holds, fleet.world, fleet.tick, fleet.time_s)
        self._overdue = {}
        return events

    def release(self) -> None:
        """Watch the assets no more: the operator has released the stop."""
        self._stop, self._overdue = None, {}

    def follow(self, commands: Sequence[DeviceCommand]) -> Iterator[ev.EventPayload]:
        """Send a mission's way to safety and see to the answers from now on; yield the events."""
        events: list[ev.CommandSent | ev.CommandRefused] = []
        self._gate.send(commands, events.append)
        yield from events
        sent = [event.command for event in events if isinstance(event, ev.CommandSent)]
        if sent:
            tick, dt_s = self._fleet.tick, self._fleet.world.dt_s
            self._open.append(Dispatch(sent, tick, dt_s, SAFETY_LIMIT_S, SAFETY_LIMIT_S))

    def step(self, step: Step) -> Iterator[ev.EventPayload]:
        """Take in one step's replies; send again what was not answered and still stands."""
        tick, replies = step
        if self._stop is not None:
            yield from self._confirm(self._stop, tick, replies)
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

    def _confirm(
        self, stop: StopConfirmation, tick: int, replies: Sequence[CommandReply]
    ) -> Iterator[ev.EventPayload]:
        """Compare a stop with answers and telemetry; report each change of what is in doubt."""
        for reply in stop.answer(replies):
            yield ev.CommandReplied(reply=reply)
        overdue = stop.look(self._fleet.picture(), self._fleet.time_s)
        if overdue != self._overdue:
            self._overdue = overdue
            yield ev.StopUnconfirmed(assets=dict(overdue))
        for command, times in stop.resends(tick, overdue):
            resent = self._gate.resend(command, times)
            if resent is not None:
                yield resent
