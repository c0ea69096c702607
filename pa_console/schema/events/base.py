"""The base of all event payloads."""

from typing import ClassVar, Literal

from pa_console.schema.base import StrictModel

Role = Literal["planner", "judge", "outcome"]
"""The roles of the model: planner, judge of a plan, judge of an outcome."""


class Payload(StrictModel):
    """Base of all event payloads; a transient one is no part of what a log tells.

    Somebody answers for what is `binding`: a decision, or a command to a device. The log is signed
    right after it.
    """

    transient: ClassVar[bool] = False
    binding: ClassVar[bool] = False
