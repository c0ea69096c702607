"""The buttons that decide about a plan, the keys that lead to them, and from when on they do."""

from collections.abc import Callable

from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.widgets import Button

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
