"""The row of view names on a small terminal, where one pane is shown at a time."""

from textual import events
from textual.content import Content
from textual.message import Message
from textual.widgets import Static

VIEWS = (
    ("map", "F2 Map"), ("assets", "F3 Assets"), ("trace", "F4 Trace"), ("events", "F5 Events"),
    ("alarms", "5 Alarms"),
)  # fmt: skip


class ViewBar(Static):
    """Names the views and says which one is shown; a click on a name chooses it."""

    class Chosen(Message):
        """A view's name was clicked."""

        def __init__(self, view: str) -> None:
            super().__init__()
            self.view = view

    def show(self, current: str) -> None:
        """Mark `current`."""
        parts: list[tuple[str, str]] = []
        for view, label in VIEWS:
            text = f" {label} "
            parts.append((text, "bold reverse $text-primary" if view == current else "$quiet"))
        self.update(Content.assemble(*parts))

    def on_click(self, event: events.Click) -> None:
        """Choose the view whose name is at the pointer."""
        end = 0
        plain = str(self.content)
        for view, label in VIEWS:
            end = plain.find(label, end) + len(label) + 2
            if event.x < end:
                self.post_message(self.Chosen(view))
                return
