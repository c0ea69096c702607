"""Asks for one line; what cannot be used is said below it, and the line stays."""

from collections.abc import Callable
from typing import Generic, TypeVar

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from pa_console.tui.widgets.fields import LineField

Answer = TypeVar("Answer")


class AskLine(ModalScreen[Answer | None], Generic[Answer]):
    """Returns what `read` makes of the line, or None."""

    BINDINGS = [Binding("escape", "leave", "Back")]

    def __init__(self, question: str, hint: str, read: Callable[[str], Answer]) -> None:
        """`read` raises ValueError that says what is wrong with a line."""
        super().__init__()
        self._question, self._hint, self._read = question, hint, read

    def compose(self) -> ComposeResult:
        """Yield the question, the field, and the hint or what is wrong."""
        with Vertical(id="ask"):
            yield Static(self._question, markup=False)
            yield LineField(compact=True, id="ask-folder")
            yield Static(self._hint, id="ask-note", markup=False)

    def on_mount(self) -> None:
        """Start in the field."""
        field = self.query_one(Input)
        field.cursor_blink = False
        field.focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Return the answer if the line is one."""
        event.stop()
        try:
            answer = self._read(event.value.strip())
        except ValueError as error:
            note = self.query_one("#ask-note", Static)
            note.update(str(error))
            note.add_class("-bad")
        else:
            self.dismiss(answer)

    def action_leave(self) -> None:
        """Return nothing."""
        self.dismiss(None)
