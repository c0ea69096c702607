"""What is known of the standing orders of a session, and how each event adds to that."""

from collections.abc import MutableMapping
from dataclasses import dataclass, field

from pa_console.schema.events import event as ev
from pa_console.schema.standing import StandingOrder

MOST_STARTS_KEPT = 100


@dataclass(frozen=True)
class StartTrace:
    """One mission that a standing order has started; `tick` is that of the simulation."""

    tick: int
    subject: str
    mission: str


@dataclass
class StandingTrace:
    """One standing order that was approved, and what came of it; `ended` is why it is over."""

    order: StandingOrder
    by: str
    since_tick: int
    starts: list[StartTrace] = field(default_factory=list[StartTrace])
    started: int = 0
    """How many missions it has started, also those before the ones in `starts`."""
    withheld: ev.StandingOrderWithheld | None = None
    """What it did not start last."""
    ended: str = ""

    @property
    def in_force(self) -> bool:
        """Whether it may still start missions."""
        return not self.ended

    @property
    def last(self) -> StartTrace | None:
        """The mission that it started last."""
        return self.starts[-1] if self.starts else None


def apply_to_standing(known: MutableMapping[str, StandingTrace], event: ev.Event) -> None:
    """Take one event in; one about an order that nobody has approved changes nothing."""
    match event.data:
        case ev.StandingOrderApproved(order=order, by=by):
            known[order.id] = StandingTrace(order, by, event.tick)
        case ev.StandingOrderStarted(order_id=name, subject=subject) if name in known:
            trace = known[name]
            trace.starts.append(StartTrace(event.tick, subject, event.mission or ""))
            del trace.starts[:-MOST_STARTS_KEPT]
            trace.started += 1
        case ev.StandingOrderWithheld(order_id=name) if name in known:
            known[name].withheld = event.data
        case ev.StandingOrderRevoked(order_id=name, by=by, reason=reason) if name in known:
            known[name].ended = f"revoked by {by}{f': {reason}' if reason else ''}"
        case ev.SessionEnded():
            for trace in known.values():
                trace.ended = trace.ended or "the session has ended"
        case _:
            pass
