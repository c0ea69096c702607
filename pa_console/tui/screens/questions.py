"""Short questions: for a line, for a folder, for a yes with a safe answer that has the focus."""

from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.screen import ModalScreen
from textual.widgets import Button, Input, Static

from pa_console.tui.widgets.fields import LineField

Answer = TypeVar("Answer")


class AskLine(ModalScreen[Answer | None], Generic[Answer]):
    """Returns what `read` makes of the line, or None."""

    BINDINGS = [Binding("escape", "leave", "Back")]

    def __init__(self, question: str, hint: str, read: Callable[[str], Answer]) -> None:
        """Ask for a line; `read` raises ValueError with its fault."""
        super().__init__()
        self._question, self._hint, self._read = question, hint, read

    def compose(self) -> ComposeResult:
        """Yield the question, the field, and the hint or the fault."""
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


class AskFolder(ModalScreen[Path | None]):
    """Returns an existing folder, or None; says so when there is no such folder."""

    BINDINGS = [Binding("escape", "leave", "Back")]

    def __init__(self, question: str, given: str = "") -> None:
        super().__init__()
        self._question, self._given = question, given

    def compose(self) -> ComposeResult:
        """Yield the question, the field and its fault."""
        with Vertical(id="ask"):
            yield Static(self._question, markup=False)
            yield LineField(self._given, compact=True, id="ask-folder", placeholder="folder")
            yield Static("Enter opens it, Esc goes back", id="ask-note", markup=False)

    def on_mount(self) -> None:
        """Start in the field."""
        field = self.query_one(Input)
        field.cursor_blink = False
        field.focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Return the folder if it is one."""
        event.stop()
        folder = Path(event.value.strip() or ".").expanduser()
        if folder.is_dir():
            self.dismiss(folder)
        else:
            note = self.query_one("#ask-note", Static)
            note.update(f"{folder}: there is no such folder")
            note.add_class("-bad")

    def action_leave(self) -> None:
        """Return nothing."""
        self.dismiss(None)


class Confirm(ModalScreen[bool]):
    """Returns True only when the operator chose to go on."""

    BINDINGS = [
        Binding("escape,n", "answer(False)", "No"),
        Binding("y", "answer(True)", "Yes"),
        Binding("left,right,up,down", "app.focus_next", show=False),
    ]

    def __init__(self, question: str, yes: str, no: str) -> None:
        super().__init__()
        self._question, self._yes, self._no = question, yes, no

    def compose(self) -> ComposeResult:
        """Yield the question and two buttons."""
        with Vertical(id="confirm"):
            yield Static(self._question, markup=False)
            with Horizontal():
                yield Button(f"{self._no} (n)", id="no", compact=True)
                yield Button(f"{self._yes} (y)", id="yes", variant="error", compact=True)

    def on_mount(self) -> None:
        """Focus the safe answer."""
        self.query_one("#no", Button).focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Answer."""
        self.dismiss(event.button.id == "yes")

    def action_answer(self, yes: bool) -> None:
        """Answer."""
        self.dismiss(yes)
