"""The screen of standing orders: their conditions, their missions, and how they ended.

An order that waits for moments of the clock shows the next one, with a countdown.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import ClassVar, Literal

from textual.binding import Binding
from textual.content import Content

from pa_console.schema.mission import StandingOrder
from pa_console.schema.text import clock_text, count
from pa_console.session.state import SessionState
from pa_console.session.state_parts import StandingTrace
from pa_console.tui.approval.plan_words import order_rows
from pa_console.tui.refresh import is_open
from pa_console.tui.rows import WrappedRow, fact, row
from pa_console.tui.screens.list_screen import ListScreen
from pa_console.tui.status_words import BAD, GOOD, QUIET, WARN
from pa_console.tui.widgets.row_views import Cells, Layout, PointedRows
from pa_console.views.event_words import next_in_words

StandingChange = Literal["revoke", "pause", "resume", "skip", "again"]
"""The changes that an operator can make to a standing order from the list."""

LOOK_S = 0.5
"""The interval between two checks for changes, in seconds."""


class StandingRows(PointedRows[StandingTrace]):
    """The list of standing orders, the oldest first."""

    COLUMNS: ClassVar[Layout] = Layout(
        "id",
        (("id", 4), ("order", 24), ("waits for", 18), ("next", 17), ("starts", 6), ("last", 15),
         ("state", 10)),
        ("waits for", "last", "starts", "next"),
    )  # fmt: skip

    dt_s = 1.0
    """The length of a tick, in simulated seconds."""
    now_s = 0.0
    """The fleet's time, from which the countdowns are measured."""

    def grown(self, room: int) -> Mapping[str, int]:
        """Give the remaining room to the order and its condition."""
        return {"order": room - room // 3, "waits for": room // 3}

    def cells(self, key: str) -> Cells:
        """Return the cells of a standing order."""
        trace = self.items[key]
        last = trace.last
        last_start = f"{last.mission} {clock_text(last.tick * self.dt_s)}" if last else "never"
        state = ("✔ in force", GOOD) if trace.in_force else ("■ over", QUIET)
        state = ("△ paused", WARN) if trace.in_force and trace.paused else state
        following = self.following(trace) if trace.in_force else ""
        return {
            "id": (key, "bold"),
            "order": (trace.order.text, "" if trace.in_force else QUIET),
            "waits for": (trace.order.words, QUIET),
            "next": (following.removeprefix("paused, "), ""),
            "starts": (f"{trace.started}", ""),
            "last": (last_start, QUIET),
            "state": state,
        }

    def detail(self) -> Iterator[WrappedRow]:
        """Yield everything about the order at the pointer."""
        trace = self.item
        if trace is None:
            yield row("", ("No standing order was approved in this session.", WARN))
            yield row(
                "", ("Type one as a mission: Whenever a drone is below 20 %, relieve it.", "")
            )
            return
        yield fact("typed", trace.order.text)
        yield from order_rows(trace.order)
        yield fact("approved", f"by {trace.by}, {self._when(trace.since_tick)}")
        if trace.in_force and trace.next is not None:
            yield fact("next", self.following(trace) or "none")
        if trace.ended:
            yield fact("over", (trace.ended, BAD))
        for start in reversed(trace.starts):
            about = f" for {start.subject}" * bool(start.subject)
            mission = f"{start.mission}{about}, {self._when(start.tick)}"
            yield fact("started", mission)
        if trace.withheld is not None:
            about = f"{trace.withheld.subject}: " * bool(trace.withheld.subject)
            yield fact("withheld", (f"{about}{trace.withheld.reason}", WARN))

    def following(self, trace: StandingTrace) -> str:
        """Return the next moment of an order and its countdown; '' if there is none."""
        return next_in_words(trace.next, self.now_s)

    def _when(self, tick: int) -> str:
        return f"at {clock_text(tick * self.dt_s)}"


class StandingOrdersScreen(ListScreen[StandingRows]):
    """The standing orders of the session, and below them the one at the pointer."""

    BINDINGS = [
        Binding("escape", "dismiss", "Back"),
        Binding("p", "pause", "Pause/resume"),
        Binding("s", "skip", "Skip next"),
        Binding("x,delete", "revoke", "Revoke"),
        Binding("a", "again", "Give again"),
    ]

    def __init__(
        self,
        state: Callable[[], SessionState],
        dt_s: float,
        change: Callable[[StandingOrder, StandingChange], object],
    ) -> None:
        """Show the orders of `state`; a tick is `dt_s` seconds, and `change` changes an order."""
        super().__init__(StandingRows(id="list"))
        self._state, self._dt_s, self._change = state, dt_s, change
        self._shown: object = None

    def on_mount(self) -> None:
        """Show the standing orders, and update them from now on."""
        self.listing.dt_s = self._dt_s
        self.listing.focus()
        self.look()
        self.set_interval(LOOK_S, self.look)

    def action_revoke(self) -> None:
        """Revoke the order at the pointer."""
        self._ask("revoke", "Revoke")

    def action_pause(self) -> None:
        """Pause the order at the pointer, or resume it."""
        trace = self.listing.item
        paused = trace is not None and trace.paused
        self._ask("resume" if paused else "pause", "Pause")

    def action_skip(self) -> None:
        """Skip the next moment of the order at the pointer."""
        self._ask("skip", "Skip")

    def action_again(self) -> None:
        """Submit an order again after its end; it then needs another approval."""
        self._ask("again", "Give again", in_force=False)

    def _ask(self, change: StandingChange, title: str, *, in_force: bool = True) -> None:
        trace = self.listing.item
        if trace is None:
            return
        if trace.in_force != in_force:
            state = "is in force" if trace.in_force else "is not in force"
            self.notify(f"{trace.order.id} {state}", title=title, markup=False)
            return
        self._change(trace.order, change)
        self.look()

    def look(self) -> None:
        """Show the changes since the last check."""
        if not is_open(self):
            return
        state = self._state()
        orders, self.listing.now_s = state.standing, state.time_s
        now = [
            (
                order.order.id,
                order.started,
                order.ended,
                order.withheld,
                self.listing.following(order),
            )
            for order in orders.values()
        ]
        if now == self._shown:
            return
        self._shown = now
        in_force = sum(order.in_force for order in orders.values())
        self.entitle(Content(f" STANDING ORDERS  {count(in_force, 'standing order')} in force"))
        self.listing.show_items(orders)
        self.show_detail()

    def detail(self) -> tuple[str, Sequence[WrappedRow]]:
        """Return everything about the order at the pointer."""
        trace = self.listing.item
        return trace.order.id if trace is not None else "", tuple(self.listing.detail())
