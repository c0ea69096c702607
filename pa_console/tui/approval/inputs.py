"""The inputs for a decision: buttons and their keys, meanings, accepted points, reason."""

from collections.abc import Callable, Sequence

from textual.app import ComposeResult
from textual.containers import Horizontal, ItemGrid, Vertical, VerticalScroll
from textual.widgets import Button

from pa_console.schema.events.event import ApprovalRequested
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.approval.choices import name_of_meaning
from pa_console.tui.approval.plan_rows import reading_label, reading_rows
from pa_console.tui.widgets.fields import CheckBox, LineField
from pa_console.tui.widgets.row_views import Row, TextRows

_FREE_KEYS = ("tab", "shift+tab", "escape", "pageup", "pagedown")
DECISION_KEYS = {"r": "reject", "m": "modify", "a": "approve"}
"""The button that each of the panel's letters goes to; Enter presses it."""


class DecisionButtons(Horizontal):
    """Reject, Modify, and Approve, which signs a plan of another station where one was joined."""

    def __init__(self, *, joined: bool) -> None:
        super().__init__(id="approval-buttons")
        self._approve = "Countersign (a)" if joined else "Approve (a)"

    def compose(self) -> ComposeResult:
        """Yield the buttons."""
        yield Button("Reject (r)", id="reject", variant="error", compact=True)
        yield Button("Modify (m)", id="modify", compact=True)
        yield Button(self._approve, id="approve", variant="success", compact=True)

    def of(self, name: str) -> Button:
        """Return the button that `DECISION_KEYS` calls by this name."""
        return self.query_one(f"#{name}", Button)


class Arming:
    """The arming of decisions: after a quiet moment, and until one is sent.

    So a key meant for another purpose decides nothing.
    """

    def __init__(self, clock: Callable[[], float], delay_s: float) -> None:
        """It has to be quiet for `delay_s` seconds of `clock`."""
        self._clock, self.delay_s = clock, delay_s
        self._quiet_since = 0.0
        self.sent = False
        """True if a decision about the shown plan was sent."""

    def disarm(self) -> None:
        """Begin to wait, because something was typed or has appeared."""
        self._quiet_since = self._clock()

    @property
    def armed(self) -> bool:
        """True if a decision is accepted now."""
        return not self.sent and self._clock() - self._quiet_since >= self.delay_s


def is_free(key: str) -> bool:
    """Return whether a key decides nothing at any focus, so that it need not wait."""
    return key in _FREE_KEYS or (key[0] == "f" and key[1:].isdigit())


REASON = "approval-reason"


class GivenFields(VerticalScroll, can_focus=False):
    """A button for each thing that the order may mean, and a box for each finding to accept."""

    def __init__(self) -> None:
        super().__init__(id="approval-given")

    def compose(self) -> ComposeResult:
        """Yield how the order was read, what else it may mean, and the boxes."""
        yield TextRows(id="approval-reading")
        yield Vertical(id="approval-readings")
        yield TextRows(id="approval-looked-at")
        yield ItemGrid(id="approval-warnings", min_column_width=18)

    def ask(self, trace: MissionTrace, request: ApprovalRequested) -> None:
        """Ask for what this request needs; nothing is ticked yet, and no other reading shown."""
        self.show_reading(())
        self.query_one("#approval-reading", TextRows).show(tuple(reading_rows(trace)))
        readings = self.query_one("#approval-readings", Vertical)
        readings.remove_children()
        readings.mount_all(
            Button(reading_label(number, asked), name=name_of_meaning(number), compact=True)
            for number, asked in enumerate(trace.choices or request.readings, start=1)
        )
        warnings = self.query_one("#approval-warnings", ItemGrid)
        warnings.remove_children()
        warnings.mount_all(
            CheckBox(f"accept {rule}", rule)
            for rule in request.acknowledge
            if not request.blocked_by
        )

    def show_reading(self, rows: Sequence[Row]) -> None:
        """Show what the reading that is looked at would lead to; nothing without rows."""
        self.query_one("#approval-looked-at", TextRows).show(tuple(rows))

    @property
    def meanings(self) -> list[Button]:
        """The buttons of what the order may mean, in their order."""
        return list(self.query("#approval-readings Button").results(Button))

    @property
    def unticked(self) -> list[CheckBox]:
        """The boxes that are still to be ticked; each has the rule for its name."""
        return [box for box in self.query(CheckBox) if not box.ticked]


class ReasonField(LineField):
    """The line under a plan: the reason for a decision, or the answer to what is asked back."""

    def __init__(self) -> None:
        super().__init__(compact=True, id=REASON, select_on_focus=False)
        self.cursor_blink = False

    def ask(self, request: ApprovalRequested) -> None:
        """Begin anew, and show the purpose in the empty field."""
        self.value = ""
        if request.needs_override and not request.blocked_by:
            self.placeholder = "Why override the judge? (required)"
        elif request.state == "not_understood":
            self.placeholder = "Your answer, Enter sends it"
        else:
            self.placeholder = "Reason (optional)"

    @property
    def said(self) -> str:
        """The written text, without blanks around it."""
        return self.value.strip()

    def add(self, text: str) -> None:
        """Write on at the end."""
        self.cursor_position = len(self.value)
        self.insert_text_at_cursor(text)
