"""Standing orders: what is to be ordered whenever the picture shows something."""

from typing import Literal

from pydantic import Field

from pa_console.schema.base import Name, StrictModel
from pa_console.schema.mission import MAX_MISSION_TEXT

SubjectKind = Literal["asset", "track", "gate"]
"""The subjects that a standing order watches, one by one."""

MOST_STARTS = 6
"""The number of missions that a standing order starts in an hour, unless it gives its own."""

SUBJECT, PLACE = "{it}", "{place}"
"""The placeholders in an order for its subject, and for that subject's gate."""


class StandingOrder(StrictModel):
    """A condition on the picture, and the order that it starts a mission with.

    Each mission is planned, checked and approved like any other; one whose order is `unasked` may
    be approved by the standing order itself, as far as the rules allow.
    """

    id: str = Field(pattern=r"^S[0-9]+$")
    text: str = Field(min_length=1, max_length=MAX_MISSION_TEXT, description="as it was given")
    each: SubjectKind
    condition: str = Field(min_length=1, description="CEL over `it`, `id`, `now` and `world`")
    words: str = Field(min_length=1, description="the condition in plain words")
    order: str = Field(min_length=1, description="with {it} and {place} for the subject")
    unasked: bool = Field(default=False, description="it says that nobody need be asked")
    most_an_hour: int = Field(default=MOST_STARTS, ge=1, le=60)

    def order_for(self, subject: str, place: str) -> str:
        """Return the order for one subject, and the gate at which that is; '' for nowhere."""
        return self.order.replace(SUBJECT, subject).replace(PLACE, place)

    @property
    def order_in_words(self) -> str:
        """The order as people read it."""
        what = {"asset": "that asset", "track": "that track", "gate": "that gate"}[self.each]
        return self.order.replace(SUBJECT, what).replace(PLACE, "its gate")


class StandingStart(StrictModel):
    """The mission that a standing order starts for one subject."""

    subject: Name
    order: str
