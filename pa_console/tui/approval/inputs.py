"""The inputs for a decision, the decision that each makes, and the reason against Approve."""

from collections.abc import Iterable, Sequence

from textual.app import ComposeResult
from textual.containers import Horizontal, ItemGrid, Vertical, VerticalScroll
from textual.widget import Widget
from textual.widgets import Button

from pa_console.schema.events.event import ApprovalRequested, DecisionMade
from pa_console.schema.mission import Decision
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.approval.plan_rows import reading_label, reading_rows
from pa_console.tui.surroundings import JoinedTo
from pa_console.tui.widgets.fields import CheckBox, LineField
from pa_console.tui.widgets.row_views import TextRows, WrappedRow

_FREE_KEYS = ("tab", "shift+tab", "escape", "pageup", "pagedown")
DECISION_KEYS = {"r": "reject", "m": "modify", "a": "approve"}
"""The button that each of the panel's letters goes to; Enter presses it."""

REASON = "approval-reason"


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


def is_free(key: str) -> bool:
    """Return whether a key decides nothing at any focus, so that it need not wait."""
    return key in _FREE_KEYS or (key[0] == "f" and key[1:].isdigit())


class MeaningButton(Button):
    """Something that the order may mean: another reading, or an answer to what is asked back."""

    def __init__(self, number: int, asked: str, *, answers: bool) -> None:
        super().__init__(reading_label(number, asked), compact=True)
        self.asked, self.answers = asked, answers


def reading_of(widget: Widget | None) -> str:
    """Return the reading of the order that a button chooses, '' for anything else."""
    return widget.asked if isinstance(widget, MeaningButton) and not widget.answers else ""


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
            MeaningButton(number, asked, answers=bool(trace.choices))
            for number, asked in enumerate(trace.choices or request.readings, start=1)
        )
        warnings = self.query_one("#approval-warnings", ItemGrid)
        warnings.remove_children()
        warnings.mount_all(
            CheckBox(f"accept {rule}", rule)
            for rule in request.acknowledge
            if not request.blocked_by
        )

    def show_reading(self, rows: Sequence[WrappedRow]) -> None:
        """Show what the reading that is looked at would lead to; nothing without rows."""
        self.query_one("#approval-looked-at", TextRows).show(tuple(rows))

    @property
    def meanings(self) -> list[MeaningButton]:
        """The buttons of what the order may mean, in their order."""
        return list(self.query(MeaningButton))

    @property
    def unticked(self) -> list[CheckBox]:
        """The boxes that are still to be ticked; each has the rule for its name."""
        return [box for box in self.query(CheckBox) if not box.ticked]


class ReasonField(LineField):
    """The line under a plan: the reason for a decision, or the answer to what is asked back."""

    def __init__(self) -> None:
        super().__init__(id=REASON, select_on_focus=False)

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


def may_modify(request: ApprovalRequested) -> bool:
    """Return whether there is a plan that the operator may change."""
    return request.standing is None and request.state != "not_understood"


def decision_of(request: ApprovalRequested, button: Button, reason: str) -> Decision | None:
    """Return the decision that a button makes of the request that waits; None for none.

    An approval accepts and overrides what the request asks for: whether that was given is for the
    panel to see to.
    """
    if isinstance(button, MeaningButton):
        if button.answers:
            return answering(request, button.asked)
        return request.decided("choose", asked=button.asked)
    if button.id == "reject":
        return request.decided("reject", reason=reason)
    return request.approved(reason) if button.id == "approve" else None


def answering(request: ApprovalRequested, answer: str) -> Decision | None:
    """Return the answer to a question about the order; None if a plan waits."""
    return request.decided("answer", asked=answer) if request.state == "not_understood" else None


def blocked_reason(request: ApprovalRequested, left: Sequence[str], reason: str) -> str:
    """Return in words why Approve is disabled, empty when it is not."""
    if request.state == "not_understood":
        return "✘ Approve: not understood, nothing is proposed"
    if request.blocked_by:
        return "✘ Approve: blocked, nobody may override"
    if left:
        return f"✘ Approve: tick {', '.join(left)} first"
    if request.needs_override and not reason.strip():
        return "✘ Approve: give a reason to override"
    return ""


def not_to_sign(joined: JoinedTo, request: ApprovalRequested, made: Iterable[DecisionMade]) -> str:
    """Return why there is nothing to sign for another station, empty if there is.

    `made` are the decisions of the mission so far.
    """
    if not request.approvals:
        return f"one person is enough: {joined.station} decides"
    now = [each.decision for each in made if each.attempt == request.attempt]
    signed = any(joined.signer in decision.signatures for decision in now)
    return f"you have signed; {joined.station} decides" if signed else ""
