"""Short dialogs that ask for a line, a folder, or yes or no, and one that opens a large log."""

from collections.abc import Callable
from pathlib import Path
from threading import Event
from typing import Generic, TypeVar

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.screen import ModalScreen, Screen
from textual.widgets import Button, Input, ProgressBar, Static

from pa_console.schema.document import DocumentError
from pa_console.session.log_index import Progress
from pa_console.session.recording import CACHED_FROM
from pa_console.tui.widgets.fields import LineField

Answer = TypeVar("Answer")

Opened = TypeVar("Opened")
LARGE = CACHED_FROM
"""The size from which the index of a log is stored, because building it takes a second or more."""


class AskLine(ModalScreen[Answer | None], Generic[Answer]):
    """A dialog for a line of text; it returns the result of `read`, or None."""

    BINDINGS = [Binding("escape", "dismiss", "Back")]

    def __init__(
        self, question: str, hint: str, read: Callable[[str], Answer], placeholder: str = ""
    ) -> None:
        """Ask for a line; `read` raises ValueError, which names the fault, for an invalid line."""
        super().__init__()
        self._question, self._hint, self._read = question, hint, read
        self._placeholder = placeholder

    def compose(self) -> ComposeResult:
        """Yield the question, the field, and the hint or the fault."""
        with Vertical(id="ask"):
            yield Static(self._question, markup=False)
            yield LineField(id="ask-folder", placeholder=self._placeholder)
            yield Static(self._hint, id="ask-note", markup=False)

    def on_mount(self) -> None:
        """Focus the field."""
        self.query_one(Input).focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Return the answer if the line is valid; otherwise, show the fault."""
        event.stop()
        try:
            answer = self._read(event.value.strip())
        except ValueError as error:
            note = self.query_one("#ask-note", Static)
            note.update(str(error))
            note.add_class("-bad")
        else:
            self.dismiss(answer)


class AskFolder(AskLine[Path]):
    """A dialog for an existing folder; it returns None if the operator goes back."""

    def __init__(self, question: str) -> None:
        super().__init__(question, "Enter opens it, Esc goes back", _folder, "folder")


def _folder(text: str) -> Path:
    folder = Path(text or ".").expanduser()
    if not folder.is_dir():
        raise ValueError(f"{folder}: there is no such folder")
    return folder


class Confirm(ModalScreen[bool]):
    """A question that returns True only if the operator chooses to go on."""

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
        """Return the answer of the button."""
        self.dismiss(event.button.id == "yes")

    def action_answer(self, yes: bool) -> None:
        """Return the answer of the key."""
        self.dismiss(yes)


class _LeftError(Exception):
    """Raised in the reading thread after the operator has left the dialog."""


def open_beside(
    over: Screen[None],
    log: Path,
    opening: Callable[[Progress | None], Opened],
    then: Callable[[Opened], None],
    problem_title: str,
) -> None:
    """Open `log`, with a progress dialog if it is large, and pass it to `then`; show any error."""

    def opened(opened_log: Opened | None) -> None:
        if opened_log is not None:
            then(opened_log)

    try:
        if log.stat().st_size >= LARGE:
            over.app.push_screen(OpeningLog(log, opening), opened)
        else:
            then(opening(None))
    except (ValueError, OSError, DocumentError) as error:
        over.notify(str(error), title=problem_title, severity="error", timeout=10, markup=False)


class OpeningLog(ModalScreen[Opened | None], Generic[Opened]):
    """A dialog that returns the result of `opening` for a log; None after an error was shown."""

    BINDINGS = [Binding("escape,q", "leave", "Stop reading")]

    def __init__(self, log: Path, opening: Callable[[Progress], Opened]) -> None:
        """Call `opening` in a thread, with a callback for its progress, in bytes."""
        super().__init__()
        self._log, self._opening, self._left = log, opening, Event()

    def compose(self) -> ComposeResult:
        """Yield the name of the log, the bar, and how to stop."""
        with Vertical(id="reading"):
            yield Static(f"Reading {self._log.name}", markup=False)
            yield ProgressBar(id="reading-bar")
            yield Static("Esc stops reading", id="reading-note")

    def on_mount(self) -> None:
        """Start to read, once the screen is mounted."""
        self.run_worker(self._read, thread=True, exit_on_error=False)

    def on_unmount(self) -> None:
        """Let the thread end at its next step."""
        self._left.set()

    def _read(self) -> None:
        try:
            opened = self._opening(self._tell)
        except _LeftError:
            return
        except (ValueError, OSError, DocumentError) as error:
            self.app.call_from_thread(self._end, None, str(error))
        else:
            self.app.call_from_thread(self._end, opened)

    def _tell(self, done: int, total: int) -> None:
        if self._left.is_set():
            raise _LeftError
        self.app.call_from_thread(self._show, done, total)

    def _show(self, done: int, total: int) -> None:
        if self.is_attached:
            self.query_one(ProgressBar).update(total=total, progress=done)

    def _end(self, opened: Opened | None, problem: str = "") -> None:
        if self._left.is_set():
            return
        if problem:
            self.app.notify(
                problem, title="Session log", severity="error", timeout=10, markup=False
            )
        self.dismiss(opened)

    def action_leave(self) -> None:
        """Close the dialog without a result; its thread ends at the next step."""
        self._left.set()
        self.dismiss(None)
