"""Commands that bring assets to a stop: sent at once, and again until every device has answered."""

from collections.abc import Iterator, Sequence

from pa_console.orchestrator.dispatch import Dispatch
from pa_console.orchestrator.feed import Step
from pa_console.schema import event as ev
from pa_console.schema.command import DeviceCommand
from pa_console.sim.checkpoint import Checkpoint

STOP_LIMIT_S = 60.0
"""A stop is sent again for so long to whoever has not answered."""


class Stops:
    """Follows stop commands that no mission follows any more."""

    def __init__(self, sim: Checkpoint) -> None:
        self._sim = sim
        self._open: list[Dispatch] = []
        self._count = 0

    @property
    def waiting(self) -> bool:
        """Whether a device has not answered yet."""
        return bool(self._open)

    def hold_all(self) -> Iterator[ev.CommandSent]:
        """Tell every asset to hold, whatever is known of it; yield the commands sent."""
        self._count += 1
        return self.follow(
            tuple(
                DeviceCommand(command_id=f"stop{self._count}.{number}", agent=name, verb="hold")
                for number, name in enumerate(self._sim.world.assets, start=1)
            )
        )

    def follow(self, commands: Sequence[DeviceCommand]) -> Iterator[ev.CommandSent]:
        """Send `commands` and see to their answers from now on; yield them."""
        for command in commands:
            self._sim.send(command)
            yield ev.CommandSent(command=command)
        if commands:
            world = self._sim.world
            follow = Dispatch(commands, self._sim.tick, world.dt_s, STOP_LIMIT_S, STOP_LIMIT_S)
            self._open.append(follow)

    def step(self, step: Step) -> Iterator[ev.EventPayload]:
        """Take in one step's replies; send again what was not answered."""
        tick, replies = step
        for stop in self._open:
            for reply in stop.advance(tick, replies):
                yield ev.CommandReplied(reply=reply)
            for command, times in stop.resends(tick):
                self._sim.send(command)
                yield ev.CommandResent(command_id=command.command_id, times=times)
        self._open = [stop for stop in self._open if not stop.finished]
