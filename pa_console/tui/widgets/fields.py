"""Fields to type in and boxes to tick.

The library puts a letter into a field at once, but lets the field's other keys (a deletion, a
movement) go round by the application first, which may be busy. What was typed after such a key
would then come before it, and be deleted with the rest.
"""

from textual import events
from textual.binding import Binding
from textual.content import Content
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Input, Static, TextArea

from pa_console.schema.text import visible


class CheckBox(Static, can_focus=True):
    """A box ticked by Space, Enter or a click; `name` identifies the accepted point."""

    BINDINGS = [Binding("enter,space", "tick", "Tick", show=False)]

    class Changed(Message):
        """The box was ticked or unticked."""

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
    """A field for one line, in one row of the screen; of pasted lines it makes one."""

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
        """Do at once what a key of this field does."""
        await _act(self, event)

    def on_paste(self, event: events.Paste) -> None:
        """Keep every line of pasted text, one behind the other; all of it stays visible."""
        event.text = " ".join(map(visible, event.text.splitlines()))


class TextField(TextArea):
    """A field for many lines; begin and end of the whole text have their usual keys."""

    BINDINGS = [
        Binding("ctrl+home", "to_edge", "Begin of the text", show=False),
        Binding("ctrl+end", "to_edge(True)", "End of the text", show=False),
        Binding("ctrl+shift+home", "to_edge(False, True)", "Select to the begin", show=False),
        Binding("ctrl+shift+end", "to_edge(True, True)", "Select to the end", show=False),
    ]

    async def on_key(self, event: events.Key) -> None:
        """Do at once what a key of this field does."""
        await _act(self, event)

    def on_paste(self, event: events.Paste) -> None:
        """Keep all of pasted text visible."""
        event.text = visible(event.text.replace("\r\n", "\n").replace("\r", "\n"))

    def action_to_edge(self, end: bool = False, select: bool = False) -> None:
        """Put the cursor at the begin or the end of the text; what lies between is selected."""
        self.move_cursor(self.document.end if end else self.document.start, select=select)


async def _act(field: Widget, event: events.Key) -> None:
    """Run the action that `field` itself binds to a key, instead of passing the key on.

    A key with Alt has a character but is none of a text: it goes on to whatever it does.
    """
    if event.key.startswith("alt+"):
        event.prevent_default()
    bound = None if event.is_printable else field.screen.active_bindings.get(event.key)
    if bound is not None and bound.node is field and bound.enabled:
        event.stop()
        event.prevent_default()
        await field.run_action(bound.binding.action)
