"""Follows the holds of a stop until telemetry shows that every asset stands, and after that."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from pa_console.orchestrator.execution.dispatch import MOST_GROWTH, RESEND_GROWTH, RESEND_S
from pa_console.schema.base import Point
from pa_console.schema.command import FINAL_REPLIES, CommandReply, DeviceCommand
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.world import World

CONFIRM_S = 1.0
"""An asset that has not answered a stop within this time is reported."""

STANDS_MPS = 0.05
"""An asset that reports no more than this stands: measured speeds are never quite zero."""

MOVED_M = 2.0
"""A standing asset's reported positions scatter less than this."""


@dataclass
class _Held:
    """One asset's hold: `sent` is the tick it last went out, `at` where the asset came to stand."""

    command: DeviceCommand
    sent: int
    times: int = 0
    reply: CommandReply | None = None
    at: Point | None = None
    doubt: str = "no answer"


class StopConfirmation:
    """Decides for each asset whether it has obeyed a stop, by its answer and by its telemetry.

    An answer alone confirms nothing: telemetry sent after the stop must show that the asset stands,
    and goes on showing it. An asset that moves again is in doubt again.
    """

    def __init__(
        self, holds: Sequence[DeviceCommand], world: World, tick: int, time_s: float
    ) -> None:
        """`tick` and `time_s` are when the stop was pressed, on the fleet's clock."""
        self._held = {hold.agent: _Held(hold, tick) for hold in holds}
        self._dt_s, self._pressed_s = world.dt_s, time_s
        # A report from just before the stop and the next picture may lie one period apart.
        self._look_s = CONFIRM_S + world.telemetry_period_s - world.dt_s

    @property
    def confirmed(self) -> bool:
        """True when telemetry shows that every asset stands."""
        return all(not held.doubt for held in self._held.values())

    def answer(self, replies: Iterable[CommandReply]) -> Iterator[CommandReply]:
        """Take in the replies of one step; yield those that are news."""
        for reply in replies:
            held = self._held.get(reply.agent)
            if held is None or reply.command_id != held.command.command_id or reply == held.reply:
                continue
            held.reply = reply
            yield reply

    def look(self, picture: Picture, time_s: float) -> Mapping[str, str]:
        """Compare with a picture; return the overdue assets, each with why it is in doubt."""
        since_s = time_s - self._pressed_s + 1e-6
        overdue: dict[str, str] = {}
        for name, held in self._held.items():
            before, held.doubt = held.doubt, self._doubt(held, picture.assets.get(name))
            if not held.doubt:
                continue
            answered = held.reply is not None and held.reply.status in FINAL_REPLIES
            moved_again = not before or held.at is not None
            if moved_again or since_s >= (self._look_s if answered else CONFIRM_S):
                overdue[name] = held.doubt
        return overdue

    def resends(self, tick: int, overdue: Mapping[str, str]) -> list[tuple[DeviceCommand, int]]:
        """Return the holds that are due again at `tick`, each with how often that makes it.

        A hold without an answer is sent again as any command is; an answered one while its asset
        is among the `overdue`.
        """
        due: list[tuple[DeviceCommand, int]] = []
        for name, held in self._held.items():
            answered = held.reply is not None and held.reply.status in FINAL_REPLIES
            if not held.doubt or (answered and name not in overdue):
                continue
            wait_s = RESEND_S * RESEND_GROWTH ** min(held.times, MOST_GROWTH)
            if (tick - held.sent) * self._dt_s >= wait_s - self._dt_s / 2:
                held.sent, held.times = tick, held.times + 1
                due.append((held.command, held.times))
        return due

    def _doubt(self, held: _Held, asset: AssetTelemetry | None) -> str:
        """Return why it is not certain that an asset stands, '' where telemetry shows it."""
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
