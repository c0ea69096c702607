"""Step 8: commands under way until each has ended: replies, resends and time-outs."""

import asyncio
from collections.abc import AsyncIterator, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from pa_console.schema.command import FINAL_REPLIES, CommandReply, DeviceCommand

Step = tuple[int, tuple[CommandReply, ...]]

ACKNOWLEDGE_S = 8.0
"""The time after which a command without any reply is given up, in seconds."""
RESEND_S = 1.0
"""The wait before the first resend of a command without a reply, in seconds."""
RESEND_GROWTH = 1.2
"""The factor by which the wait for the next resend grows each time."""
MOST_GROWTH = 10
"""The number of times that the wait for the next resend grows, until it is near ASK_AGAIN_S."""

ASK_AGAIN_S = 6.5
"""The wait before a command is resent to a device that has fallen silent, in seconds."""
TIMED_OUT = "timed out"
"""The beginning of the detail of a reply that the station makes itself after a time-out."""


class StepFeed:
    """A feed of steps from the station's clock to its followers, of which none misses a step."""

    def __init__(self) -> None:
        self._followers: list[asyncio.Queue[Step]] = []

    @property
    def wanted(self) -> bool:
        """True while a follower has processed every step and waits for the next."""
        return any(queue.empty() for queue in self._followers)

    def publish(self, tick: int, replies: Sequence[CommandReply]) -> None:
        """Publish one step to all followers."""
        for queue in self._followers:
            queue.put_nowait((tick, tuple(replies)))

    @contextmanager
    def follow(self) -> Generator[AsyncIterator[Step]]:
        """Yield an endless iterator over all steps from now on."""
        queue: asyncio.Queue[Step] = asyncio.Queue()
        self._followers.append(queue)
        try:
            yield _drain(queue)
        finally:
            self._followers.remove(queue)


async def _drain(queue: asyncio.Queue[Step]) -> AsyncIterator[Step]:
    while True:
        yield await queue.get()


@dataclass
class _OpenCommand:
    """A command under way, with the ticks at which it was last `sent` and last `replied` to."""

    command: DeviceCommand
    sent: int
    times: int = 0
    replied: int | None = None
    last: CommandReply | None = None


class Dispatch:
    """The commands of one plan under way, each of which ends by a final reply or a time-out.

    The class sends nothing itself: the caller sends the commands that `resends` returns. Resending
    is harmless, because a device carries out a command id once and then repeats its last answer.
    """

    def __init__(
        self,
        commands: Iterable[DeviceCommand],
        tick: int,
        dt_s: float,
        limit_s: float,
        acknowledge_s: float = ACKNOWLEDGE_S,
    ) -> None:
        """Follow commands that were first sent at `tick`; each must end within `limit_s`.

        A command without any reply within `acknowledge_s` is given up.
        """
        self._acknowledge_s = acknowledge_s
        self._open = {command.command_id: _OpenCommand(command, tick) for command in commands}
        self._started, self._dt_s, self._limit_s = tick, dt_s, limit_s
        self.final: dict[str, CommandReply] = {}
        """The last reply of each agent whose command has ended."""

    @property
    def finished(self) -> bool:
        """True when every command has ended."""
        return not self._open

    @property
    def open_agents(self) -> tuple[str, ...]:
        """The agents whose command has not ended."""
        return tuple(entry.command.agent for entry in self._open.values())

    @property
    def open_commands(self) -> tuple[DeviceCommand, ...]:
        """The commands that have not ended."""
        return tuple(entry.command for entry in self._open.values())

    def forget(self, command: DeviceCommand) -> None:
        """Stop following `command`, because its device was sent another one."""
        self._open.pop(command.command_id, None)

    def advance(self, tick: int, replies: Iterable[CommandReply]) -> Iterator[CommandReply]:
        """Process the replies of `tick`; yield the new ones for this plan, time-outs included.

        A reply that is repeated, or older than the last one, is not yielded, but still shows that
        the device responds.
        """
        for reply in replies:
            entry = self._open.get(reply.command_id)
            if entry is None:
                continue
            entry.replied = tick
            final = reply.status in FINAL_REPLIES
            if final or entry.last is None or _is_news(reply, entry.last):
                entry.last = reply
                yield self._note(reply)
        elapsed = self._seconds(self._started, tick)
        for entry in list(self._open.values()):
            if entry.replied is None and elapsed > min(self._acknowledge_s, self._limit_s):
                limit_s = min(self._acknowledge_s, self._limit_s)
                yield self._give_up(entry, tick, f"no acknowledgement within {limit_s:.0f} s")
            elif elapsed > self._limit_s:
                yield self._give_up(entry, tick, f"not done within {self._limit_s:.0f} s")

    def resends(self, tick: int) -> list[tuple[DeviceCommand, int]]:
        """Return the commands to resend at `tick`, each with its number of resends.

        A command without any reply is due after RESEND_S, then at growing intervals. A command
        whose device has replied and then fallen silent is due after ASK_AGAIN_S. A second call for
        the same tick returns an empty list.
        """
        due: list[tuple[DeviceCommand, int]] = []
        for entry in self._open.values():
            wait_s = ASK_AGAIN_S
            if entry.replied is None:
                wait_s = RESEND_S * RESEND_GROWTH ** min(entry.times, MOST_GROWTH)
            since = max(entry.sent, entry.replied or entry.sent)
            if self._seconds(since, tick) >= wait_s - self._dt_s / 2:
                entry.sent, entry.times = tick, entry.times + 1
                due.append((entry.command, entry.times))
        return due

    def _seconds(self, since: int, tick: int) -> float:
        return (tick - since) * self._dt_s

    def _give_up(self, entry: _OpenCommand, tick: int, problem: str) -> CommandReply:
        sent = f", sent {entry.times + 1} times" if entry.replied is None and entry.times else ""
        return self._note(_failed(entry, tick, f"{TIMED_OUT}: {problem}{sent}"))

    def _note(self, reply: CommandReply) -> CommandReply:
        if reply.status in FINAL_REPLIES:
            self.final[reply.agent] = reply
            del self._open[reply.command_id]
        return reply


def _is_news(reply: CommandReply, last: CommandReply) -> bool:
    return reply.tick >= last.tick and reply != last


def _failed(entry: _OpenCommand, tick: int, detail: str) -> CommandReply:
    return CommandReply(
        command_id=entry.command.command_id,
        agent=entry.command.agent,
        status="failed",
        tick=tick,
        detail=detail,
    )
