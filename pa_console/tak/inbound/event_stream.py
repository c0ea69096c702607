"""Cuts what a server sends into events; however it is malformed, little of it is kept."""

BEGIN, END = b"<event", b"</event>"
MOST_BYTES = 65_536
"""A longer event is none; the schema's own examples have a tenth of that."""


class EventStream:
    """Takes bytes as they come and gives whole events; `broken` counts what was too long."""

    def __init__(self, most: int = MOST_BYTES) -> None:
        """`most` is how many bytes of an event that has not ended yet are kept."""
        self._most = most
        self._rest = bytearray()
        self._skipping = False
        self.broken = 0

    def feed(self, data: bytes) -> list[bytes]:
        """Return the events that end in `data`, each from `<event` to `</event>`."""
        found: list[bytes] = []
        searched = max(len(self._rest) - len(END) + 1, 0)
        self._rest += data
        begin = 0
        while (end := self._rest.find(END, max(begin, searched))) >= 0:
            document = bytes(self._rest[begin : end + len(END)])
            begin = end + len(END)
            if self._skipping or len(document) > self._most:
                self.broken += not self._skipping
                self._skipping = False
            elif (start := document.find(BEGIN)) >= 0:
                found.append(document[start:])
        del self._rest[:begin]
        if len(self._rest) > self._most:
            self.broken += not self._skipping
            self._skipping = True
            del self._rest[: -len(END) + 1]
        return found
