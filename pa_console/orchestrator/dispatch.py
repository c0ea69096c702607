"""Step 7: follows dispatched commands from acknowledgement to their end, with time-outs."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from pa_console.schema.command import FINAL_REPLIES, CommandReply, DeviceCommand

ACKNOWLEDGE_S = 3.0


@dataclass
class _Open:
    command: DeviceCommand
    acknowledged: bool = False


class Dispatch:
    """The commands of one plan on their way; fed with replies and time, it says how each ended."""

    def __init__(
        self, commands: Iterable[DeviceCommand], tick: int, dt_s: float, limit_s: float
    ) -> None:
        """Start at `tick`; every command must be acknowledged at once and end within `limit_s`."""
        self._open = {command.command_id: _Open(command) for command in commands}
        self._started, self._dt_s, self._limit_s = tick, dt_s, limit_s
        self.final: dict[str, CommandReply] = {}
        """The last reply per agent, once its command has ended."""

    @property
    def finished(self) -> bool:
        """Whether every command has ended."""
        return not self._open

    @property
    def open_agents(self) -> tuple[str, ...]:
        """The agents whose command has not ended."""
        return tuple(entry.command.agent for entry in self._open.values())

    def advance(self, tick: int, replies: Iterable[CommandReply]) -> Iterator[CommandReply]:
        """Take in the replies of `tick`; yield those that concern this plan, time-outs included."""
        for reply in replies:
            entry = self._open.get(reply.command_id)
            if entry is not None:
                entry.acknowledged = True
                yield self._note(reply)
        elapsed = (tick - self._started) * self._dt_s
        for command_id, entry in list(self._open.items()):
            if not entry.acknowledged and elapsed > ACKNOWLEDGE_S:
                yield self._give_up(command_id, entry, tick, "no acknowledgement", ACKNOWLEDGE_S)
            elif elapsed > self._limit_s:
                yield self._give_up(command_id, entry, tick, "not done", self._limit_s)

    def _give_up(
        self, command_id: str, entry: _Open, tick: int, what: str, limit_s: float
    ) -> CommandReply:
        return self._note(
            CommandReply(
                command_id=command_id,
                agent=entry.command.agent,
                status="failed",
                tick=tick,
                detail=f"timed out: {what} within {limit_s:.0f} s",
            )
        )

    def _note(self, reply: CommandReply) -> CommandReply:
        if reply.status in FINAL_REPLIES:
            self.final[reply.agent] = reply
            del self._open[reply.command_id]
        return reply
