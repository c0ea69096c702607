"""A standing order as rows, for the approval panel and the list."""

from collections.abc import Collection, Iterator

from pa_console.schema.events.event import StandingOrderRead
from pa_console.schema.mission import StandingOrder
from pa_console.schema.text import count
from pa_console.tui.status_words import CALM, NOTE, QUIET, WARN
from pa_console.tui.trace.rows import Row, row
from pa_console.views.event_words import asked_in_words

_LEAD = 10


def offered_rows(read: StandingOrderRead) -> Iterator[Row]:
    """Yield all facts of a standing order before its approval."""
    yield row(("▶ ", NOTE), (f"Standing order {read.order.id}: ", f"bold {NOTE}"),
              "it holds from your approval until you revoke it or the session ends")  # fmt: skip
    yield from order_rows(read.order, read.allowed)
    for start in read.now:
        yield row(_lead("now"), (f"{start.subject}: ", "bold"), (start.order, WARN))
    if not read.now:
        yield row(_lead("now"), "it would start nothing: the condition holds of nobody")


def order_rows(order: StandingOrder, allowed: Collection[str] | None = None) -> Iterator[Row]:
    """Yield an order's condition, in words and as CEL, its missions and its approvals."""
    yield row(_lead("whenever"), (order.words, "bold"))
    yield row(_lead("in CEL"), (order.condition, CALM))
    yield row(_lead("it starts"), order.order_in_words)
    style = WARN if order.unasked else ""
    yield row(_lead("approval"), (asked_in_words(order, allowed), style))
    yield row(_lead("limit"), f"{count(order.most_an_hour, 'start')} an hour")


def _lead(name: str) -> tuple[str, str]:
    return f"{name:<{_LEAD}}", QUIET
