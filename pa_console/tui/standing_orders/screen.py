"""The standing orders: what each waits for and starts, what it has started, and its end."""

from collections.abc import Callable

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.screen import Screen
from textual.widgets import Static

from pa_console.schema.text import count
from pa_console.session.state import SessionState
from pa_console.tui.refresh import is_open
from pa_console.tui.standing_orders.listing import StandingRows
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.row_views import TextRows

LOOK_S = 0.5
"""The interval between two looks for changes, seconds."""


class StandingOrdersScreen(Screen[None]):
    """The standing orders of the session above, the one at the pointer below."""

    BINDINGS = [
        Binding("escape", "dismiss", "Back"),
        Binding("x,delete", "revoke", "Revoke"),
    ]

    def __init__(
        self, state: Callable[[], SessionState], dt_s: float, revoke: Callable[[str], object]
    ) -> None:
        """Show those of `state`, a tick of `dt_s` seconds; `revoke` takes one out of force."""
        super().__init__()
        self._state, self._dt_s, self._revoke = state, dt_s, revoke
        self._shown: object = None

    def compose(self) -> ComposeResult:
        """Yield the title, the list with its heading, and the detail."""
        yield Static(id="standing-title", markup=False)
        with Vertical():
            yield Static(id="standing-heading", markup=False)
            yield StandingRows(id="standing-list")
            with VerticalScroll(id="standing-detail"):
                yield TextRows(id="standing-sheet")
        yield KeyFooter()

    @property
    def listing(self) -> StandingRows:
        """The list of standing orders."""
        return self.query_one(StandingRows)

    def on_mount(self) -> None:
        """Show what there is, and from now on what becomes of it."""
        self.listing.focus()
        self.look()
        self.set_interval(LOOK_S, self.look)

    def on_resize(self, _event: events.Resize) -> None:
        """Lay out for the new width."""
        self.call_after_refresh(self._detail)

    def action_revoke(self) -> None:
        """Take the order at the pointer out of force."""
        trace = self.listing.trace
        if trace is None:
            return
        if not trace.in_force:
            self.notify(f"{trace.order.id} is not in force", title="Revoke", markup=False)
            return
        self._revoke(trace.order.id)
        self.look()

    def look(self) -> None:
        """Show the changes since the last look."""
        if not is_open(self):
            return
        orders = self._state().standing
        now = [(each.order.id, each.started, each.ended, each.withheld) for each in orders.values()]
        if now == self._shown:
            return
        self._shown = now
        in_force = sum(each.in_force for each in orders.values())
        title = f" STANDING ORDERS  {count(in_force, 'standing order')} in force"
        self.query_one("#standing-title", Static).update(Content(title))
        self.listing.show(orders, self._dt_s)
        self._detail()

    @on(StandingRows.Pointed)
    def _pointed(self, event: StandingRows.Pointed) -> None:
        event.stop()
        self._detail()
        self.query_one("#standing-detail", VerticalScroll).scroll_home(animate=False)

    def _detail(self) -> None:
        self.query_one("#standing-heading", Static).update(self.listing.heading())
        trace = self.listing.trace
        title = trace.order.id if trace is not None else ""
        self.query_one("#standing-detail").border_title = title
        self.query_one("#standing-sheet", TextRows).show(tuple(self.listing.detail()))
