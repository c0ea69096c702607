"""The messages that the console needs from an autopilot and requests until they arrive.

Without requests, an ArduPilot sends only heartbeats. It loses the requests at a restart.
"""

from dataclasses import dataclass, field

from pa_console.fleets.readiness import MessageWatch, NeededMessage
from pa_console.schema.world import AssetKind

POSITION = "GLOBAL_POSITION_INT"
GRACE_S = 2.0
"""The delay beyond two periods after which a message is requested again, in seconds."""

ASK_S = 3.0
"""The least time between two requests for the same message, in seconds."""


def needed_messages(kind: AssetKind, position_s: float) -> tuple[NeededMessage, ...]:
    """Return the messages needed from a vehicle of `kind`, with a position every `position_s`."""
    lands = NeededMessage("EXTENDED_SYS_STATE", 1.0, "it counts as landed while disarmed", 245)
    return (
        NeededMessage("HEARTBEAT", 1.0, "its mode is unknown, and it accepts no orders", 0),
        NeededMessage(POSITION, position_s, "its place is unknown, and it accepts no orders", 33),
        NeededMessage(
            "SYS_STATUS", 1.0, "its battery counts as low, and its arming checks are unknown", 1
        ),
        *((lands,) if kind == "uav" else ()),
        NeededMessage(
            "HOME_POSITION", 5.0, "the place that it returns to is unknown", 242, patience_s=90.0
        ),
    )


@dataclass
class RequestedMessages(MessageWatch):
    """The arrivals of a vehicle's messages, and the requests for them."""

    _asked: dict[str, float] = field(default_factory=dict[str, float])

    def ask_again(self, now_s: float) -> None:
        """Forget all arrivals and requests, so that every message is requested again."""
        self._asked.clear()
        self._heard.clear()
        self.began_s = now_s

    def due(self, now_s: float) -> list[NeededMessage]:
        """Return the messages to request now, and record them as requested."""
        due = [
            needed
            for needed in self.needed
            if now_s - self.last_s(needed.name) > 2 * needed.period_s + GRACE_S
            and now_s - self._asked.get(needed.name, -ASK_S) >= ASK_S
            and needed.number
        ]
        self._asked |= {needed.name: now_s for needed in due}
        return due
