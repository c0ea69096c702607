"""Events of a TAK server: the connection to it, and what other clients of it say is around.

A contact is a report that nobody has verified: it is shown, and decides nothing.
"""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from pa_console.schema.base import NonNegative, Point, StrictModel
from pa_console.schema.events.base import Payload
from pa_console.schema.events.session import Noticed

MOST_CONTACTS = 64
"""The number of contacts kept at a time."""

MOST_UID, MOST_CALLSIGN = 128, 48
"""A longer uid is none; a longer call sign is cut. Characters."""

TakState = Literal["connected", "away"]
LossReason = Literal["stale", "removed", "left"]
"""Its report holds no longer, its sender took it off the map, or it is beyond the site."""

ClaimedAffiliation = Literal[
    "friend", "assumed friend", "neutral", "unknown", "pending", "suspect", "hostile", "other"
]
ClaimedKind = Literal[
    "aircraft", "ground unit", "vehicle", "installation", "ground object", "vessel", "submarine",
    "spacecraft", "special forces", "object",
]  # fmt: skip

Count = Annotated[int, Field(ge=0)]


class ReportedContact(StrictModel):
    """The report of a TAK client on a thing; `at` is in metres, as all positions are."""

    uid: str = Field(min_length=1, max_length=MOST_UID)
    callsign: str = Field(default="", max_length=MOST_CALLSIGN)
    affiliation: ClaimedAffiliation
    what: ClaimedKind
    at: Point
    error_m: NonNegative | None = Field(default=None, description="radius, None where not told")
    time: datetime = Field(description="when it was there, as claimed; never after it was heard")
    stale: datetime = Field(description="until when that holds, as claimed, up to a limit")

    @property
    def name(self) -> str:
        """The name of the thing: its call sign, else its uid."""
        return self.callsign or self.uid


class TakChanged(Payload):
    """The connection to the TAK server is there, or is not and is tried again."""

    kind: Literal["tak"] = "tak"
    server: str = Field(description="tls://HOST:PORT or tcp://HOST:PORT")
    state: TakState
    detail: str = ""


class ContactReported(Payload):
    """A contact is new, or something else is claimed of it, or it is somewhere else."""

    kind: Literal["contact_reported"] = "contact_reported"
    contact: ReportedContact


class ContactLost(Payload):
    """A contact is reported no more."""

    kind: Literal["contact_lost"] = "contact_lost"
    uid: str
    reason: LossReason


class ContactsLeftOut(Payload):
    """The number of messages from the server that are not shown so far.

    `outside` are contacts beyond the site, `too_many` those beyond the limits of number and time,
    and `unreadable` malformed events.
    """

    kind: Literal["contacts_left_out"] = "contacts_left_out"
    outside: Count = 0
    too_many: Count = 0
    unreadable: Count = 0


UNVERIFIED = (TakChanged, ContactReported, ContactLost, ContactsLeftOut)
"""The events of a TAK server; no part that answers, plans or decides reads them."""

OutsideReport = TakChanged | ContactReported | ContactLost | ContactsLeftOut | Noticed
"""All that may come into a session from a TAK server; none of it is a picture or an order."""
