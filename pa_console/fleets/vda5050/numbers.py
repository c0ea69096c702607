"""Numbers of messages: those that are sent, counted by topic, and those that came."""

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from pa_console.fleets.vda5050.topics import Identity
from pa_console.fleets.vda5050.wire import VERSION


class Numbers:
    """Counts messages by `<serial number>/<topic>`."""

    def __init__(self) -> None:
        self._sent: dict[str, int] = {}
        self._seen: dict[str, int] = {}
        self._fresh: dict[str, int] = {}

    def header(self, identity: Identity, topic: str, sent: datetime) -> dict[str, Any]:
        """Return the header of the next message to, or from, `identity` on a topic."""
        key = f"{identity.serial_number}/{topic}"
        number = self._sent[key] = self._fresh[key] = self._sent.get(key, 0) + 1
        return {
            "header_id": number,
            "timestamp": sent,
            "version": VERSION,
            "manufacturer": identity.manufacturer,
            "serial_number": identity.serial_number,
        }

    def fresh(self) -> dict[str, int]:
        """Return the number of the last message by topic, of those sent since the last call."""
        fresh, self._fresh = self._fresh, {}
        return fresh

    def saw(self, identity: Identity, topic: str, number: int) -> None:
        """Note that the message of this number has come."""
        self._seen[f"{identity.serial_number}/{topic}"] = number

    def has_seen(self, numbers: Mapping[str, int]) -> bool:
        """Return whether every one of the messages has come, or a later one of its topic."""
        return all(self._seen.get(key, 0) >= number for key, number in numbers.items())
