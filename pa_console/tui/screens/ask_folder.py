"""Asks for a folder; what is typed is kept as it is, `~` is the user's home."""

from pathlib import Path

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from pa_console.tui.widgets.fields import LineField


class AskFolder(ModalScreen[Path | None]):
    """Returns an existing folder, or None; says so when there is no such folder."""

    BINDINGS = [Binding("escape", "leave", "Back")]

    def __init__(self, question: str, given: str = "") -> None:
        super().__init__()
        self._question, self._given = question, given

    def compose(self) -> ComposeResult:
        """Yield the question, the field and what is wrong with it."""
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
