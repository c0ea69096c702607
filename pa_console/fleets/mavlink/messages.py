"""The messages that the console needs from an autopilot; they are asked for until they come.

An ArduPilot sends nothing but heartbeats that it is not asked for, and forgets what it was asked
for when it starts again.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from pa_console.fleets.link import LinkFinding
from pa_console.schema.world import AssetKind


@dataclass(frozen=True)
class NeededMessage:
    """One message of the MAVLink common set; `lacking` is the consequence of its absence."""

    name: str
    number: int
    period_s: float
    lacking: str
    flown: bool = False
    """True if only aircraft send it."""
    patience_s: float = 15.0
    """One that has been asked for so long without coming is reported as missing."""


POSITION = "GLOBAL_POSITION_INT"
NEEDED = (
    NeededMessage("HEARTBEAT", 0, 1.0, "its mode is unknown, and it takes no orders"),
    NeededMessage(POSITION, 33, 0.25, "its place is unknown, and it takes no orders"),
    NeededMessage(
        "SYS_STATUS", 1, 1.0, "its battery counts as low, and why it does not arm is unknown"
    ),
    NeededMessage("EXTENDED_SYS_STATE", 245, 1.0, "it counts as landed while disarmed", flown=True),
    NeededMessage(
        "HOME_POSITION", 242, 5.0, "the place that it returns to is unknown", patience_s=90.0
    ),
)

GRACE_S = 2.0
"""A message is late by so much beyond two of its periods before it is asked for again."""

ASK_S = 3.0
"""The time between two requests for the same message."""

KEPT = 64


@dataclass
class MessageWatch:
    """Counts one vehicle's messages; times are those of a monotonic clock, seconds."""

    kind: AssetKind
    position_s: float
    """The period at which positions are needed."""
    began_s: float
    _heard: dict[str, deque[float]] = field(default_factory=dict[str, deque[float]])
    _asked: dict[str, float] = field(default_factory=dict[str, float])

    @property
    def needed(self) -> Iterator[NeededMessage]:
        """The messages that a vehicle of its kind sends."""
        return (each for each in NEEDED if self.kind == "uav" or not each.flown)

    def period_s(self, needed: NeededMessage) -> float:
        """Return the period that is asked for."""
        return self.position_s if needed.name == POSITION else needed.period_s

    def heard(self, name: str, now_s: float) -> None:
        """Count a message."""
        self._heard.setdefault(name, deque(maxlen=KEPT)).append(now_s)

    def ask_again(self, now_s: float) -> None:
        """Have every message asked for: the vehicle may have forgotten what it was asked for."""
        self._asked.clear()
        self.began_s = now_s
        for times in self._heard.values():
            times.clear()

    def due(self, now_s: float) -> list[NeededMessage]:
        """Return the messages to ask for now; each counts as asked for by that."""
        found = [
            needed
            for needed in self.needed
            if self._late(needed, now_s)
            and now_s - self._asked.get(needed.name, -ASK_S) >= ASK_S
            and needed.number
        ]
        for needed in found:
            self._asked[needed.name] = now_s
        return found

    def missing(self, now_s: float) -> list[NeededMessage]:
        """Return the messages that do not come although they have been asked for."""
        return [
            needed
            for needed in self.needed
            if now_s - max(self._last(needed.name), self.began_s) > needed.patience_s
        ]

    def count(self, name: str) -> int:
        """Return how many of a message have come lately."""
        return len(self._heard.get(name, ()))

    def rate_hz(self, name: str, now_s: float) -> float:
        """Return how often a message has come lately, 0 if it did not."""
        times = self._heard.get(name, ())
        if len(times) < 2:
            return 0.0
        return (len(times) - 1) / max(now_s - times[0], 1e-3)

    def _late(self, needed: NeededMessage, now_s: float) -> bool:
        return now_s - self._last(needed.name) > 2 * self.period_s(needed) + GRACE_S

    def _last(self, name: str) -> float:
        times = self._heard.get(name)
        return times[-1] if times else -1e9


def message_findings(agent: str, watch: MessageWatch, now_s: float) -> list[LinkFinding]:
    """Return how often each needed message of a vehicle comes, and what lacks without it."""
    found: list[LinkFinding] = []
    for needed in watch.needed:
        count, rate = watch.count(needed.name), watch.rate_hz(needed.name, now_s)
        said = f"{rate:.1f} a second" if rate else f"{count} so far" if count else "never"
        wanted = "" if count else f"every {watch.period_s(needed):g} s"
        found.append(LinkFinding(agent, needed.name, said, wanted, "" if count else needed.lacking))
    return found
