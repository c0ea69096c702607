"""Events of standing orders: what one would do, that it is in force, what it starts, its end."""

from typing import ClassVar, Literal

from pydantic import Field

from pa_console.schema.base import Name
from pa_console.schema.events.base import Payload
from pa_console.schema.standing import StandingOrder, StandingStart


class StandingOrderRead(Payload):
    """Step 1: how an order is read that is to hold from now on; nobody has approved it yet."""

    kind: Literal["standing_order_read"] = "standing_order_read"
    order: StandingOrder
    now: tuple[StandingStart, ...] = Field(default=(), description="what it would start at once")
    allowed: tuple[str, ...] = Field(
        default=(), description="the commands that may be given unasked by it, as the rules say"
    )


class StandingOrderApproved(Payload):
    """An operator has approved the standing order; it is in force until it is revoked."""

    binding: ClassVar[bool] = True
    kind: Literal["standing_order_approved"] = "standing_order_approved"
    order: StandingOrder
    by: str


class StandingOrderStarted(Payload):
    """The condition became true of `subject`, and a mission was queued for it."""

    kind: Literal["standing_order_started"] = "standing_order_started"
    order_id: str
    subject: Name


class StandingOrderWithheld(Payload):
    """The condition became true of `subject`, and nothing was started; `reason` says why."""

    kind: Literal["standing_order_withheld"] = "standing_order_withheld"
    order_id: str
    subject: str = ""
    reason: str


class StandingOrderRevoked(Payload):
    """The standing order is in force no more."""

    binding: ClassVar[bool] = True
    kind: Literal["standing_order_revoked"] = "standing_order_revoked"
    order_id: str
    by: str
    reason: str = ""
