"""Where missions are typed, with a history that up and down walk through."""

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.content import Content
from textual.message import Message
from textual.widgets import Input, Static

from pa_console.schema.mission import MAX_MISSION_TEXT
from pa_console.tui.kept_input import History
from pa_console.tui.widgets.fields import LineField

ELSEWHERE = "Say in plain words what is to be done; i brings you here"
"""What the empty prompt says while keys go elsewhere: the first thing that an operator reads."""

_HERE = "Say in plain words what is to be done; Enter sends it"


class MissionInput(LineField):
    """A line of text; what was typed is kept until the mission was taken."""

    BINDINGS = [
        Binding("up", "history(-1)", "Earlier mission", show=False),
        Binding("down", "history(1)", "Later mission", show=False),
    ]

    def __init__(self, history: History) -> None:
        super().__init__(
            max_length=MAX_MISSION_TEXT,
            compact=True,
            id="mission-input",
            placeholder=ELSEWHERE,
        )
        self.cursor_blink = False
        self._history = history

    def watch_has_focus(self, has_focus: bool) -> None:
        """Say the key that leads here only while keys go elsewhere."""
        super().watch_has_focus(has_focus)
        self.placeholder = _HERE if has_focus else ELSEWHERE

    def action_history(self, by: int) -> None:
        """Replace the text by an earlier or later one."""
        self.value = self._history.move(by, self.value)
        self.cursor_position = len(self.value)


class MissionPrompt(Horizontal):
    """The prompt line; closed, it says why no mission can be given."""

    class Given(Message):
        """The operator sent a mission."""

        def __init__(self, text: str) -> None:
            super().__init__()
            self.text = text

    class Typed(Message):
        """The operator is writing a mission, `text` so far."""

        def __init__(self, text: str) -> None:
            super().__init__()
            self.text = text

    def __init__(self, history: History, closed: str = "") -> None:
        """`closed` is the reason why no missions are taken, empty for an open prompt."""
        super().__init__(id="prompt")
        self._history, self._closed_why = history, closed

    def compose(self) -> ComposeResult:
        """Yield the label and the field."""
        if self._closed_why:
            yield Static(Content.styled(f" {self._closed_why} ", "bold"), id="prompt-closed")
        else:
            yield Static("Mission ❯ ", id="prompt-label")
            yield MissionInput(self._history)

    def on_input_changed(self, event: Input.Changed) -> None:
        """Tell that a mission is on its way."""
        event.stop()
        if event.value.strip():
            self.post_message(self.Typed(event.value))

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Pass the text on; an empty line is nothing."""
        event.stop()
        if event.value.strip():
            self.post_message(self.Given(event.value))

    def taken(self, text: str) -> None:
        """Clear the field after `text` was accepted, and remember it."""
        self._history.add(text)
        self.query_one(MissionInput).value = ""

    @property
    def draft(self) -> str:
        """What is typed and not yet sent."""
        return "" if self._closed_why else self.query_one(MissionInput).value

    @property
    def has_cursor(self) -> bool:
        """Whether keys go to the field."""
        return not self._closed_why and self.query_one(MissionInput).has_focus

    def take_cursor(self) -> None:
        """Let keys go to the field, the very next one too."""
        if not self._closed_why:
            self.screen.set_focus(self.query_one(MissionInput))
