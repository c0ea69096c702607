"""What is still to be sent to a TAK server: bounded, the newest of each thing, from any thread."""

from collections.abc import Iterable
from threading import Lock

from pa_console.tak.cot_event import CotEvent

MOST = 10_000
"""So many events wait at most: the largest world has 2000 assets with a way each."""


class Outbox:
    """Holds one event a thing; what is newer takes the place of what is older.

    When it is full, whatever has waited longest is dropped. Nobody who puts something in waits.
    """

    def __init__(self, most: int = MOST) -> None:
        """`most` is how many events wait at most."""
        self._most = most
        self._waiting: dict[str, CotEvent] = {}
        self._lock = Lock()
        self.dropped = 0
        """How many things the map was never told of because too many waited."""

    def put(self, events: Iterable[CotEvent]) -> None:
        """Let `events` be sent, in this order."""
        with self._lock:
            for event in events:
                self._waiting.pop(event.subject, None)
                self._waiting[event.subject] = event
            while len(self._waiting) > self._most:
                del self._waiting[next(iter(self._waiting))]
                self.dropped += 1

    def take(self) -> CotEvent | None:
        """Return what has waited longest, which waits no more; None when nothing waits."""
        with self._lock:
            oldest = next(iter(self._waiting), None)
            return self._waiting.pop(oldest) if oldest is not None else None

    def __len__(self) -> int:
        with self._lock:
            return len(self._waiting)
