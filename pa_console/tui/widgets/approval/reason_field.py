"""The line under a plan: the reason for a decision, or the answer to what is asked back."""

from pa_console.schema.events.event import ApprovalRequested
from pa_console.tui.widgets.fields import LineField

REASON = "approval-reason"


class ReasonField(LineField):
    """Where the operator says why, or what was meant."""

    def __init__(self) -> None:
        super().__init__(compact=True, id=REASON, select_on_focus=False)
        self.cursor_blink = False

    def ask(self, request: ApprovalRequested) -> None:
        """Begin anew, and say in the empty field what it is for."""
        self.value = ""
        if request.needs_override and not request.blocked_by:
            self.placeholder = "Why override the judge? (required)"
        elif request.state == "not_understood":
            self.placeholder = "Your answer, Enter sends it"
        else:
            self.placeholder = "Reason (optional)"

    @property
    def said(self) -> str:
        """What was written, without blanks around it."""
        return self.value.strip()

    def add(self, text: str) -> None:
        """Write on at the end."""
        self.cursor_position = len(self.value)
        self.insert_text_at_cursor(text)
