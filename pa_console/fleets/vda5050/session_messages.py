"""A session that a station shares on the bus, and what a console that has joined it sends back.

The station publishes the records of its log on `<interface>/v3/pa-console/<station>/records`.
Whoever has joined sends `recordsAsked`, `countersignature` and `stopAsked` to the same station.
"""

import base64
import binascii
import zlib
from typing import Annotated, ClassVar

from pydantic import StringConstraints

from pa_console.fleets.vda5050.wire import MOST_BYTES, Count, Header, Id, UnreadableError

MOST_UNPACKED = 4 << 20
"""The largest size of the records in one message, bytes."""

_Packed = Annotated[str, StringConstraints(max_length=MOST_BYTES)]
_Signed = Annotated[str, StringConstraints(max_length=65_536)]


class SessionRecords(Header):
    """Records of a session log, one after another, for which the station vouches.

    `packed` are their lines, each with its end, as zlib data in base64. `signature` is a JWT by the
    station.
    """

    TOPIC: ClassVar[str] = "records"
    session: Id
    first: Count
    last: Count
    packed: _Packed
    signature: _Signed

    def lines(self) -> list[bytes]:
        """Return the lines without their ends; raises UnreadableError for what holds none."""
        unpacking = zlib.decompressobj()
        try:
            lines = unpacking.decompress(
                base64.b64decode(self.packed, validate=True), MOST_UNPACKED
            )
        except (zlib.error, binascii.Error, ValueError) as error:
            raise UnreadableError(f"its records cannot be unpacked: {error}") from None
        if not unpacking.eof or not lines.endswith(b"\n"):
            raise UnreadableError("its records are incomplete or too many")
        return lines[:-1].split(b"\n")


def pack(lines: bytes) -> str:
    """Return whole lines as `SessionRecords.packed`."""
    return base64.b64encode(zlib.compress(lines, 1)).decode()


class RecordsAsked(Header):
    """A joined console's request for the records of a session from `first` on."""

    TOPIC: ClassVar[str] = "recordsAsked"
    session: Id
    first: Count


class Countersignature(Header):
    """A second person approves the plan that waits at a station; `approval` is the signed JWT."""

    TOPIC: ClassVar[str] = "countersignature"
    session: Id
    request_id: Id
    person: Id
    approval: _Signed


class StopAsked(Header):
    """A joined console's request for a stop of all assets; a stop needs no signature."""

    TOPIC: ClassVar[str] = "stopAsked"
    session: Id
    person: Id
