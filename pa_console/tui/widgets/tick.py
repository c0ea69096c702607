"""A box to tick that shows its state by a sign, not only by a colour."""

from textual.binding import Binding
from textual.content import Content
from textual.message import Message
from textual.widgets import Static


class Tick(Static, can_focus=True):
    """Ticked by Space, Enter or a click; `name` says what is accepted."""

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
