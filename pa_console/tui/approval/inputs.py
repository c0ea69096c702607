"""The inputs of the approval panel, their decisions, and the reason why Approve is disabled."""

from collections.abc import Iterable, Sequence

from textual.app import ComposeResult
from textual.containers import Horizontal, ItemGrid, Vertical, VerticalScroll
from textual.widget import Widget
from textual.widgets import Button

from pa_console.schema.events.event import ApprovalRequested, DecisionMade
from pa_console.schema.mission import Decision
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.approval.plan_words import reading_label, reading_rows
from pa_console.tui.surroundings import JoinedTo
from pa_console.tui.widgets.fields import CheckBox, LineField
from pa_console.tui.widgets.row_views import TextRows, WrappedRow

_FREE_KEYS = ("tab", "shift+tab", "escape", "pageup", "pagedown")
DECISION_KEYS = {"r": "reject", "m": "modify", "a": "approve"}
"""The id of the button that each letter key of the panel selects; Enter presses the button."""

REASON = "approval-reason"


class DecisionButtons(Horizontal):
    """The buttons Reject, Modify and Approve; in a joined session, Approve is Countersign."""

    def __init__(self, *, joined: bool) -> None:
        super().__init__(id="approval-buttons")
        self._approve = "Countersign (a)" if joined else "Approve (a)"

    def compose(self) -> ComposeResult:
        """Yield the buttons."""
        yield Button("Reject (r)", id="reject", variant="error", compact=True)
        yield Button("Modify (m)", id="modify", compact=True)
        yield Button(self._approve, id="approve", variant="success", compact=True)

    def of(self, name: str) -> Button:
        """Return the button with the id `name`, as in `DECISION_KEYS`."""
        return self.query_one(f"#{name}", Button)


def is_free(key: str) -> bool:
    """Return True for a key that decides nothing and so works before the panel is armed."""
    return key in _FREE_KEYS or (key[0] == "f" and key[1:].isdigit())


class MeaningButton(Button):
    """A button for a meaning of the order: another reading, or an answer to a question about it."""

    def __init__(self, number: int, asked: str, *, answers: bool) -> None:
        super().__init__(reading_label(number, asked), compact=True)
        self.asked, self.answers = asked, answers


def reading_of(widget: Widget | None) -> str:
    """Return the reading that a button chooses; '' for any other widget."""
    return widget.asked if isinstance(widget, MeaningButton) and not widget.answers else ""


class GivenFields(VerticalScroll, can_focus=False):
    """The buttons of the order's possible meanings, and a box for each finding to accept."""

    def __init__(self) -> None:
        super().__init__(id="approval-given")

    def compose(self) -> ComposeResult:
        """Yield the rows of the readings, the buttons and the boxes, all still empty."""
        yield TextRows(id="approval-reading")
        yield Vertical(id="approval-readings")
        yield TextRows(id="approval-looked-at")
        yield ItemGrid(id="approval-warnings", min_column_width=18)

    def ask(self, trace: MissionTrace, request: ApprovalRequested) -> None:
        """Show the inputs for this request; no box is ticked, and no other reading is shown."""
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
        """Show `rows`, the consequences of the selected reading; hide them if empty."""
        self.query_one("#approval-looked-at", TextRows).show(tuple(rows))

    @property
    def meanings(self) -> list[MeaningButton]:
        """The buttons of the possible meanings, in order."""
        return list(self.query(MeaningButton))

    @property
    def unticked(self) -> list[CheckBox]:
        """The boxes that are not ticked yet; each box has the id of its rule as its name."""
        return [box for box in self.query(CheckBox) if not box.ticked]


class ReasonField(LineField):
    """The field below a plan for the reason for a decision, or for the answer to a question."""

    def __init__(self) -> None:
        super().__init__(id=REASON, select_on_focus=False)

    def ask(self, request: ApprovalRequested) -> None:
        """Clear the field, and show its purpose in it."""
        self.value = ""
        if request.needs_override and not request.blocked_by:
            self.placeholder = "Why override the judge? (required)"
        elif request.state == "not_understood":
            self.placeholder = "Your answer; press Enter to send it"
        else:
            self.placeholder = "Reason (optional)"

    @property
    def text(self) -> str:
        """The text of the field, without spaces around it."""
        return self.value.strip()

    def add(self, text: str) -> None:
        """Append `text` at the end."""
        self.cursor_position = len(self.value)
        self.insert_text_at_cursor(text)


def may_modify(request: ApprovalRequested) -> bool:
    """Return whether the request has a plan that the operator may change."""
    return request.standing is None and request.state != "not_understood"


def decision_of(request: ApprovalRequested, button: Button, reason: str) -> Decision | None:
    """Return the decision that a button makes about the waiting request; None if it makes none.

    An approval acknowledges and overrides everything that the request asks for. The panel has
    checked that the operator ticked every box and gave any reason that is required.
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
    """Return the reason why Approve is disabled; empty if it is enabled."""
    if request.state == "not_understood":
        return "✘ Approve: not understood, nothing is proposed"
    if request.blocked_by:
        return "✘ Approve: blocked, nobody may override it"
    if left:
        return f"✘ Approve: tick {', '.join(left)} first"
    if request.needs_override and not reason.strip():
        return "✘ Approve: give a reason to override"
    return ""


def not_to_sign(joined: JoinedTo, request: ApprovalRequested, made: Iterable[DecisionMade]) -> str:
    """Return the reason why another station needs no signature from here; empty if it needs one.

    `made` are the decisions of the mission so far.
    """
    if not request.approvals:
        return f"this plan needs no second signature: {joined.station} decides"
    now = [event.decision for event in made if event.attempt == request.attempt]
    signed = any(joined.signer in decision.signatures for decision in now)
    return f"you have signed; {joined.station} decides" if signed else ""
