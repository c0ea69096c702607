"""The buttons that decide about a plan, and the keys that lead to them."""

from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.widgets import Button

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
