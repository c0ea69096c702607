"""Where missions are typed, in as many lines as they need, with a history."""

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.content import Content
from textual.message import Message
from textual.widgets import Static, TextArea

from pa_console.tui.kept_input import History
from pa_console.tui.refresh import retitle
from pa_console.tui.widgets.fields import TextField

ELSEWHERE = "Say in plain words what is to be done; / brings you here"
"""What the empty prompt says while keys go elsewhere: the first thing that an operator reads."""

_HERE = "Say in plain words what is to be done; Enter sends it"


class MissionInput(TextField):
    """A few lines of text; what was typed is kept until the mission was taken."""

    BINDINGS = [
        Binding("enter", "send", "Send", show=False),
        Binding("ctrl+j,alt+enter,shift+enter", "new_line", "New line", show=False),
        Binding("up", "earlier", "Earlier mission", show=False),
        Binding("down", "later", "Later mission", show=False),
    ]

    class Sent(Message):
        """Enter was pressed."""

    _instead = ""

    def __init__(self, history: History) -> None:
        super().__init__(
            compact=True,
            id="mission-input",
            placeholder=ELSEWHERE,
            tab_behavior="focus",
            highlight_cursor_line=False,
        )
        self.cursor_blink = False
        self._missions = history

    def watch_has_focus(self, focus: bool) -> None:
        """Say the key that leads here only while keys go elsewhere."""
        self._watch_has_focus(focus)
        self._say()

    def say_instead(self, text: str) -> None:
        """Say `text` in the empty field; with an empty text, what the field is for."""
        self._instead = text
        self._say()

    def _say(self) -> None:
        said = self._instead or (_HERE if self.has_focus else ELSEWHERE)
        if self.placeholder != said:
            self.placeholder = said

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Leave the function keys, by which a text area selects, to the console."""
        if action in ("select_line", "select_all"):
            return False
        return super().check_action(action, parameters)

    def action_send(self) -> None:
        """Tell that the text is to be sent."""
        self.post_message(self.Sent())

    def action_new_line(self) -> None:
        """Begin a new line."""
        self.insert("\n")

    def action_earlier(self) -> None:
        """Go a line up, from the first to the mission before."""
        if self.cursor_at_first_line:
            self._recall(-1)
        else:
            self.action_cursor_up()

    def action_later(self) -> None:
        """Go a line down, from the last to the mission after."""
        if self.cursor_at_last_line:
            self._recall(1)
        else:
            self.action_cursor_down()

    def _recall(self, by: int) -> None:
        self.text = self._missions.move(by, self.text)
        self.move_cursor(self.document.end)


class MissionPrompt(Horizontal):
    """The prompt; closed, it says why no mission can be given."""

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

    def on_text_area_changed(self, event: TextArea.Changed) -> None:
        """Tell that a mission is on its way."""
        event.stop()
        if self.draft.strip():
            self.post_message(self.Typed(self.draft))

    def on_mission_input_sent(self, event: MissionInput.Sent) -> None:
        """Pass the text on; an empty field is nothing."""
        event.stop()
        if self.draft.strip():
            self.post_message(self.Given(self.draft))

    def taken(self, text: str) -> None:
        """Clear the field after `text` was accepted, and remember it."""
        self._history.add(text)
        self.query_one(MissionInput).text = ""

    def show_waiting(self, text: str) -> None:
        """Say what is being waited for: in the line above, or in the field where there is none.

        A text that is being typed is never covered.
        """
        shown = f"◔ {text}" if text else ""
        above = bool(self.styles.border_top[0])
        retitle(self, shown if above else "")
        for field in self.query(MissionInput):
            field.say_instead("" if above else shown)

    @property
    def draft(self) -> str:
        """What is typed and not yet sent."""
        return "" if self._closed_why else self.query_one(MissionInput).text

    @property
    def has_cursor(self) -> bool:
        """Whether keys go to the field."""
        return not self._closed_why and self.query_one(MissionInput).has_focus

    def take_cursor(self) -> None:
        """Let keys go to the field, the very next one too."""
        if not self._closed_why:
            self.screen.set_focus(self.query_one(MissionInput))
