"""The standing orders of a session, a row each, and the details of the one at the pointer."""

from collections.abc import Iterator, Mapping

from pa_console.schema.text import clock_text
from pa_console.session.state import StandingTrace
from pa_console.tui.standing_orders.rows import order_rows
from pa_console.tui.status_words import BAD, GOOD, QUIET, WARN
from pa_console.tui.trace.rows import Row, row
from pa_console.tui.widgets.row_views import Cells, Layout, PointedRows

_LEAST = Layout(
    "id",
    (("id", 4), ("order", 24), ("condition", 20), ("starts", 6), ("last", 18), ("state", 10)),
    ("condition", "last", "starts"),
)


class StandingRows(PointedRows):
    """The list of standing orders, the oldest first."""

    def __init__(self, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._orders: Mapping[str, StandingTrace] = {}
        self._dt_s = 1.0

    @property
    def trace(self) -> StandingTrace | None:
        """The standing order at the pointer."""
        return self._orders.get(self.cursor)

    def show(self, orders: Mapping[str, StandingTrace], dt_s: float) -> None:
        """Show these; a tick is `dt_s` simulated seconds."""
        self._orders, self._dt_s = dict(orders), dt_s
        self.set_keys(list(self._orders))

    def layout_of(self, width: int) -> Layout:
        """Return the columns that fit; the order gets what is left."""
        columns = _LEAST.fitting(width - 1)
        room = max(0, width - sum(cells + 1 for _, cells in columns))
        more = {"order": room - room // 3, "condition": room // 3}
        return Layout("id", tuple((name, cells + more.get(name, 0)) for name, cells in columns), ())

    def cells(self, key: str) -> Cells:
        """Return the cells of a standing order."""
        trace = self._orders[key]
        last = trace.last
        told = f"{last.mission} {clock_text(last.tick * self._dt_s)}" if last else "never"
        state = ("✔ in force", GOOD) if trace.in_force else ("■ over", QUIET)
        return {
            "id": (key, "bold"),
            "order": (trace.order.text, "" if trace.in_force else QUIET),
            "condition": (trace.order.words, QUIET),
            "starts": (f"{trace.started}", ""),
            "last": (told, QUIET),
            "state": state,
        }

    def detail(self) -> Iterator[Row]:
        """Yield everything about the order at the pointer."""
        trace = self.trace
        if trace is None:
            yield row("", ("No standing order was approved in this session.", WARN))
            yield row(
                "", ("Type one as a mission: Whenever a drone is below 20 %, relieve it.", "")
            )
            return
        yield row(("typed     ", QUIET), trace.order.text)
        yield from order_rows(trace.order)
        yield row(("approved  ", QUIET), f"by {trace.by}, {self._when(trace.since_tick)}")
        if trace.ended:
            yield row(("over      ", QUIET), (trace.ended, BAD))
        for start in reversed(trace.starts):
            told = f"{start.mission} for {start.subject}, {self._when(start.tick)}"
            yield row(("started   ", QUIET), told)
        if trace.withheld is not None:
            about = f"{trace.withheld.subject}: " * bool(trace.withheld.subject)
            yield row(("not       ", QUIET), (f"{about}{trace.withheld.reason}", WARN))

    def _when(self, tick: int) -> str:
        return f"at {clock_text(tick * self._dt_s)}"
