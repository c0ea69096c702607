"""A limit on the messages of each sender: more than any robot reports, less than a flood."""

from collections import OrderedDict
from collections.abc import Callable

from pa_console.fleets.vda5050.topics import Topic

MESSAGES_PER_S, MESSAGES_AT_ONCE = 100.0, 200.0
"""A robot reports some times a second; a simulated site that runs twenty times faster, 40 times."""

BYTES_PER_S, BYTES_AT_ONCE = 512_000.0, 1_024_000.0
"""A state has two to ten kilobytes; reading these takes some milliseconds of each second."""

MOST_SENDERS = 20_000
"""The number of senders and topics with a share of their own; the longest silent are forgotten."""


class RateLimit:
    """A token bucket for each sender and topic, of messages and of bytes."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """`clock` returns seconds."""
        self._clock = clock
        self._left: OrderedDict[Topic, tuple[float, float, float]] = OrderedDict()
        """Messages and bytes left, and the moment of that, by topic."""

    def allows(self, topic: Topic, size: int) -> bool:
        """Take a message of `size` bytes off its sender's share; return False beyond it."""
        now = self._clock()
        full = (MESSAGES_AT_ONCE, BYTES_AT_ONCE, now)
        messages, octets, then = self._left.pop(topic, full)
        messages = min(messages + (now - then) * MESSAGES_PER_S, MESSAGES_AT_ONCE)
        octets = min(octets + (now - then) * BYTES_PER_S, BYTES_AT_ONCE)
        allowed = messages >= 1.0 and octets >= size
        if allowed:
            messages, octets = messages - 1.0, octets - size
        self._left[topic] = (messages, octets, now)
        if len(self._left) > MOST_SENDERS:
            self._left.popitem(last=False)
        return allowed
