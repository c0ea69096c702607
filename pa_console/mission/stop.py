"""Commands that stop assets, sent at once and resent until each asset is known to stand still."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from pa_console.fleets.fleet import Fleet
from pa_console.mission.execution.dispatch import (
    MOST_GROWTH,
    RESEND_GROWTH,
    RESEND_S,
    Dispatch,
    Step,
)
from pa_console.mission.gate import CommandGate
from pa_console.schema.base import Point
from pa_console.schema.command import FINAL_REPLIES, CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.world import World

CONFIRM_S = 1.0
"""The time after which an asset that is not known to stand still is reported, in seconds."""

STANDS_MPS = 0.05
"""The highest reported speed, in m/s, of a standing asset; measured speeds are rarely zero."""

MOVED_M = 2.0
"""The largest scatter in the reported positions of an asset that stands still, in metres."""

AGAIN_S = 0.2
"""The time between two resends of an unanswered hold, in seconds. The first resend comes after
FIRST_AGAIN_S, when most assets have answered."""
FIRST_AGAIN_S = 0.4

QUICK_TRIES = 30
"""The number of resends at intervals of AGAIN_S. On a link that loses four of five messages, all of
them are lost for one hold in a thousand."""

MOST_AT_ONCE = 100
"""The largest number of holds resent in one step; those that have waited longest come first."""

SAFETY_LIMIT_S = 60.0
"""The time for which a way to safety is resent to assets that have not answered, in seconds."""


@dataclass
class _Held:
    """The hold of one asset, last `sent` at a tick; `at` is the position where the asset stopped.

    `times` is the number of resends so far, of which `slow` were at long intervals. `quick` is the
    number of resends left at short intervals. `silent` is True while the picture has no fresh
    telemetry of the asset.
    """

    command: DeviceCommand
    sent: int
    times: int = 0
    quick: int = QUICK_TRIES
    slow: int = 0
    silent: bool = False
    reply: CommandReply | None = None
    at: Point | None = None
    doubt: str = "no answer"

    @property
    def ended(self) -> bool:
        """True if the asset has sent its final reply."""
        return self.reply is not None and self.reply.status in FINAL_REPLIES

    @property
    def hurries(self) -> bool:
        """True while the asset has not answered the stop and quick resends remain."""
        return self.reply is None and self.quick > 0

    @property
    def wait_s(self) -> float:
        """The time from the last sending to the next, in seconds."""
        if self.hurries:
            return AGAIN_S if self.times else FIRST_AGAIN_S
        return RESEND_S * RESEND_GROWTH ** min(self.slow, MOST_GROWTH)

    def sent_again(self, tick: int) -> tuple[DeviceCommand, int]:
        """Record a resend at `tick`; return the command and its number of resends."""
        if self.hurries:
            self.quick -= 1
        else:
            self.slow += 1
        self.sent, self.times = tick, self.times + 1
        return self.command, self.times


class StopConfirmation:
    """The confirmation of a stop by the answer and the telemetry of each asset.

    An answer alone confirms nothing. Telemetry sent after the stop must also show that the asset
    stands still, and continue to show it. If an asset moves again, it is in doubt again.
    """

    def __init__(
        self, holds: Sequence[DeviceCommand], world: World, tick: int, time_s: float
    ) -> None:
        """Begin at `tick` and `time_s`, the fleet's time at which the stop was pressed."""
        self._held = {hold.agent: _Held(hold, tick) for hold in holds}
        self._dt_s, self._pressed_s = world.dt_s, time_s
        # The first report after the stop may arrive a whole period later.
        self._look_s = CONFIRM_S + world.telemetry_period_s - world.dt_s

    @property
    def confirmed(self) -> bool:
        """True if telemetry shows that every asset stands still."""
        return all(not held.doubt for held in self._held.values())

    def answer(self, replies: Iterable[CommandReply]) -> Iterator[CommandReply]:
        """Process the replies of one step; yield the new ones."""
        for reply in replies:
            held = self._held.get(reply.agent)
            if held is None or reply.command_id != held.command.command_id or reply == held.reply:
                continue
            held.reply = reply
            yield reply

    def look(self, picture: Picture, time_s: float) -> Mapping[str, str]:
        """Compare the stop with a picture; return the overdue assets, each with its doubt."""
        since_s = time_s - self._pressed_s + 1e-6
        overdue: dict[str, str] = {}
        for name, held in self._held.items():
            asset = picture.assets.get(name)
            silent = asset is None or asset.stale
            if held.silent and not silent:
                held.quick, held.slow = QUICK_TRIES, 0
            before, held.doubt, held.silent = held.doubt, self._doubt(held, asset), silent
            if not held.doubt:
                continue
            moved_again = not before or held.at is not None
            if moved_again or since_s >= (self._look_s if held.ended else CONFIRM_S):
                overdue[name] = held.doubt
        return overdue

    def resends(self, tick: int, overdue: Mapping[str, str]) -> list[tuple[DeviceCommand, int]]:
        """Return the holds to resend at `tick`, each with its number of resends.

        An unanswered hold is due every AGAIN_S, QUICK_TRIES times, and then at growing intervals,
        like any command. When a silent asset reports again, the quick resends start over. A hold
        with a final reply is due only while its asset is `overdue`. A resent hold keeps its id, so
        that the device recognizes the repetition.
        """
        due = [
            held
            for name, held in self._held.items()
            if held.doubt
            and (not held.ended or name in overdue)
            and (tick - held.sent) * self._dt_s >= held.wait_s - self._dt_s / 2
        ]
        due.sort(key=lambda held: held.sent)
        return [held.sent_again(tick) for held in due[:MOST_AT_ONCE]]

    def _doubt(self, held: _Held, asset: AssetTelemetry | None) -> str:
        """Return why it is not certain that an asset stands still; '' if telemetry shows it."""
        reply = held.reply
        if asset is None or reply is None or reply.status not in FINAL_REPLIES:
            return "no answer"
        if reply.status != "done" and asset.status != "failed":
            return f"it refuses: {reply.detail}"
        if asset.stamp_s <= self._pressed_s or asset.stale:
            return "no telemetry since"
        if asset.integrity != "ok":
            return "its telemetry cannot be relied on"
        if asset.speed_mps > STANDS_MPS or asset.task in ("moving", "returning"):
            return "it moves"
        if held.at is not None and math.dist(held.at, asset.position) > MOVED_M:
            return "its position changes"
        held.at = held.at or asset.position
        return ""


class EmergencyStop:
    """The stop of all assets, and the ways to safety of missions that were ended early."""

    def __init__(self, fleet: Fleet, gate: CommandGate) -> None:
        self._fleet, self._gate = fleet, gate
        self._open: list[Dispatch] = []
        self._stop: StopConfirmation | None = None
        self._overdue: Mapping[str, str] = {}

    @property
    def waiting(self) -> bool:
        """True while a way to safety is not completed, or an asset is not known to stand still."""
        return bool(self._open) or (self._stop is not None and not self._stop.confirmed)

    def hold_all(self) -> list[ev.EventPayload]:
        """Stop everything: send every asset a hold, whatever its state; return the events.

        A hold is resent, with no time limit, until telemetry shows that its asset stands still. It
        is resent again if the asset moves again before `release`.
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
        """Stop watching the assets, because the operator has released the stop."""
        self._stop, self._overdue = None, {}

    def follow(self, commands: Sequence[DeviceCommand]) -> Iterator[ev.EventPayload]:
        """Send the commands of a mission's way to safety; yield the events. `step` resends them."""
        events: list[ev.CommandSent | ev.CommandRefused] = []
        self._gate.send(commands, events.append)
        yield from events
        sent = [event.command for event in events if isinstance(event, ev.CommandSent)]
        if sent:
            tick, dt_s = self._fleet.tick, self._fleet.world.dt_s
            self._open.append(Dispatch(sent, tick, dt_s, SAFETY_LIMIT_S, SAFETY_LIMIT_S))

    def step(self, step: Step) -> Iterator[ev.EventPayload]:
        """Process the replies of one step; resend unanswered commands that are still valid."""
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
        """Compare a stop with replies and telemetry, and resend holds; yield the events."""
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
