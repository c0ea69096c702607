"""Fields to type in and boxes to tick.

Textual puts a letter into a field at once, but passes the field's other keys (a deletion, a
movement) through the app, which may be busy. Text typed after such a key would then arrive before
the key and be deleted with the rest. These fields therefore run their keys at once.
"""

from textual import events
from textual.binding import Binding
from textual.content import Content
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Input, Static, TextArea

from pa_console.schema.text import visible


class CheckBox(Static, can_focus=True):
    """A box that Space, Enter or a click ticks; `name` is the id of the rule to acknowledge."""

    BINDINGS = [Binding("enter,space", "tick", "Tick", show=False)]

    class Changed(Message):
        """Posted when the box is ticked or unticked."""

    def __init__(self, label: str, name: str) -> None:
        super().__init__(name=name)
        self._text = label
        self.ticked = False

    def on_mount(self) -> None:
        """Show the empty box."""
        self._paint()

    def action_tick(self) -> None:
        """Tick or untick."""
        self.ticked = not self.ticked
        self._paint()
        self.post_message(self.Changed())

    def on_click(self) -> None:
        """Tick or untick."""
        self.action_tick()

    def _paint(self) -> None:
        box = ("[✔]", "bold $text-success") if self.ticked else ("[ ]", "bold $text-warning")
        self.update(Content.assemble(box, f" {self._text}"))


class LineField(Input):
    """A field for one line, in one row of the screen; pasted lines are joined."""

    def __init__(
        self,
        value: str | None = None,
        *,
        id: str | None = None,  # noqa: A002 - as every widget names it
        placeholder: str = "",
        select_on_focus: bool = True,
    ) -> None:
        super().__init__(value, placeholder, id=id, select_on_focus=select_on_focus, compact=True)
        self.cursor_blink = False

    async def on_key(self, event: events.Key) -> None:
        """Run a key of this field at once."""
        await _act(self, event)

    def on_paste(self, event: events.Paste) -> None:
        """Join the lines of pasted text; invisible characters become escapes."""
        event.text = " ".join(map(visible, event.text.splitlines()))


class TextField(TextArea):
    """A field for many lines, with the usual keys for the beginning and the end of the text."""

    BINDINGS = [
        Binding("ctrl+home", "to_edge", "Beginning of the text", show=False),
        Binding("ctrl+end", "to_edge(True)", "End of the text", show=False),
        Binding("ctrl+shift+home", "to_edge(False, True)", "Select to the beginning", show=False),
        Binding("ctrl+shift+end", "to_edge(True, True)", "Select to the end", show=False),
    ]

    async def on_key(self, event: events.Key) -> None:
        """Run a key of this field at once."""
        await _act(self, event)

    def on_paste(self, event: events.Paste) -> None:
        """Insert pasted text; invisible characters become escapes."""
        event.text = visible(event.text.replace("\r\n", "\n").replace("\r", "\n"))

    def action_to_edge(self, end: bool = False, select: bool = False) -> None:
        """Move the cursor to the beginning or end of the text; `select` extends the selection."""
        self.move_cursor(self.document.end if end else self.document.start, select=select)


async def _act(field: Widget, event: events.Key) -> None:
    """Run the action that `field` itself binds to a key, instead of passing the key on.

    A key with Alt has a character but types none, so it is passed on.
    """
    if event.key.startswith("alt+"):
        event.prevent_default()
    bound = None if event.is_printable else field.screen.active_bindings.get(event.key)
    if bound is not None and bound.node is field and bound.enabled:
        event.stop()
        event.prevent_default()
        await field.run_action(bound.binding.action)
