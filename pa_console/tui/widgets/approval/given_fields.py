"""The operator's inputs for a decision: the meaning, the accepted points, the reason."""

from collections.abc import Sequence

from textual.app import ComposeResult
from textual.containers import ItemGrid, Vertical, VerticalScroll
from textual.widgets import Button

from pa_console.schema.events.event import ApprovalRequested
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.plan_preview.approval_rows import reading_label, reading_rows
from pa_console.tui.widgets.approval.choices import name_of_meaning
from pa_console.tui.widgets.fields import CheckBox, LineField
from pa_console.tui.widgets.row_views import Row, TextRows

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
