"""Orders to begin with, each typed into the prompt by a key or a click; none is sent."""

from collections.abc import Sequence

from textual.app import ComposeResult
from textual.containers import Vertical
from textual.content import Content
from textual.message import Message
from textual.widgets import Static

from pa_console.tui.actions.registry import key_text
from pa_console.tui.status_words import NOTE, QUIET

HEADING = "To begin: a key types the order, Enter sends it"


class ExampleLine(Static):
    """One order."""

    class Clicked(Message):
        """The order was clicked."""

        def __init__(self, order: str) -> None:
            super().__init__()
            self.order = order

    def __init__(self, number: int, order: str) -> None:
        key = key_text(f"alt+{number}")
        super().__init__(Content.assemble((f"{key}  ", f"bold {NOTE}"), order))
        self._order = order

    def on_click(self) -> None:
        """Post that it was clicked."""
        self.post_message(self.Clicked(self._order))


class ExampleOrders(Vertical):
    """Shown until the first mission of a session."""

    class Taken(Message):
        """One of the orders was chosen."""

        def __init__(self, order: str) -> None:
            super().__init__()
            self.order = order

    def __init__(self, orders: Sequence[str], **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"))
        self.orders = tuple(orders)

    def compose(self) -> ComposeResult:
        """Yield a line an order."""
        yield Static(Content.styled(HEADING, QUIET))
        for number, order in enumerate(self.orders, start=1):
            yield ExampleLine(number, order)

    def on_example_line_clicked(self, message: ExampleLine.Clicked) -> None:
        """Pass the clicked example on."""
        message.stop()
        self.post_message(self.Taken(message.order))
