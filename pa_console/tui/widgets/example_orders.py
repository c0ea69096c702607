"""Orders to begin with, each typed into the prompt by a key or a click; none is sent."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle

from textual.app import ComposeResult
from textual.containers import Vertical
from textual.content import Content
from textual.message import Message
from textual.widgets import Static

from pa_console.schema.world import AssetKind, World
from pa_console.tui.actions import key_text
from pa_console.tui.status_words import NOTE, QUIET

MOST = 4


def example_orders(world: World) -> tuple[str, ...]:
    """Return up to four orders, each with another gate as long as there are others.

    The assets in them are spare ones where there are any: no gate is their post.
    """
    gates = cycle(world.gates)
    orders: list[str] = []
    if drone := _spare(world, ("uav",)):
        orders.append(f"Send {drone} to look at {next(gates)}.")
    if walker := _spare(world, ("ugv", "robot")):
        orders.append(f"Send {walker} to {next(gates)}.")
    orders.append(f"Report on {next(gates)}.")
    if robot := _spare(world, ("robot", "ugv", "uav")):
        orders.append(f"Send {robot} home.")
    return tuple(orders[:MOST])


def _spare(world: World, kinds: tuple[AssetKind, ...]) -> str:
    """Return an asset of the first kind that there is; empty without any."""
    return next(_by_choice(world, kinds), "")


def _by_choice(world: World, kinds: tuple[AssetKind, ...]) -> Iterator[str]:
    for kind in kinds:
        own = [name for name, spec in world.assets.items() if spec.kind == kind]
        yield from (name for name in own if world.assets[name].post not in world.gates)
        yield from own


HEADING = "To begin: a key types the order, Enter sends it"


class ExampleLine(Static):
    """One order."""

    @dataclass
    class Clicked(Message):
        """The order was clicked."""

        order: str

    def __init__(self, number: int, order: str) -> None:
        key = key_text(f"alt+{number}")
        super().__init__(Content.assemble((f"{key}  ", f"bold {NOTE}"), order))
        self._order = order

    def on_click(self) -> None:
        """Post that it was clicked."""
        self.post_message(self.Clicked(self._order))


class ExampleOrders(Vertical):
    """Shown until the first mission of a session."""

    @dataclass
    class OrderChosen(Message):
        """One of the orders was chosen."""

        order: str

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
        self.post_message(self.OrderChosen(message.order))
