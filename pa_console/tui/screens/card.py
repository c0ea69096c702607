"""The card of a thing on the map: what is known of it, and what may be ordered or looked at."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.content import Content
from textual.geometry import Offset
from textual.screen import ModalScreen
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from pa_console.schema.telemetry import AssetTelemetry, Track
from pa_console.schema.world import PLAIN_KINDS, World
from pa_console.session.wording import link_in_words
from pa_console.tui.order_templates import forms_for
from pa_console.tui.status_words import KIND_WORDS

WIDTH = 46
"""Cells of a card; it is as high as what is on it."""


class CardChoice(NamedTuple):
    """A line of the card: it types `order`, gives it at once, or is the console's action `does`."""

    name: str
    order: str = ""
    does: str = ""


GIVE = "give"
"""What a line does whose order is given at once: it moves no asset."""
FOLLOW = CardChoice("Follow on the map", does="follow")
MAP_CHOICES = (
    CardChoice("Nearer", does="zoom_in"),
    CardChoice("Farther", does="zoom_out"),
    CardChoice("What sensors see", does="sensors"),
)
"""The choices for an empty place on the map."""


def asset_choices(asset: AssetTelemetry, *, taken: bool) -> list[CardChoice]:
    """Return the possible orders to this asset; one that has failed can only be looked at.

    Under manual control it takes none: if it was `taken` here, it can be given back.
    """
    if taken:
        return [FOLLOW, CardChoice("Give back (m)", f"Give {asset.id} back.", GIVE)]
    if asset.status == "failed" or asset.manual:
        return [FOLLOW]
    orders = [
        CardChoice(form.name, form.text.replace("{asset}", asset.id))
        for form in forms_for(asset.kind)
    ]
    take = CardChoice("Take manual control (m)", f"Take over {asset.id}.", GIVE)
    return [*orders, take, FOLLOW]


def track_choices(track: Track, world: World) -> list[CardChoice]:
    """Return what the team can do about a track."""
    kinds = {spec.kind for spec in world.assets.values()}
    found: list[CardChoice] = []
    if "uav" in kinds:
        found.append(CardChoice("Look at it", f"Send a drone to look at {track.gate}."))
    if "robot" in kinds:
        about = f"{track.id} at {track.gate}"
        found.append(CardChoice("Identify it", f"Send a robot to identify {about}."))
        if track.identity != "authorized":
            found.append(CardChoice("Warn it", f"Send a robot to warn {about}."))
    return [*found, FOLLOW]


def frame_choices(name: str, world: World) -> list[CardChoice]:
    """Return what can be ordered for a place."""
    kinds = {spec.kind for spec in world.assets.values()}
    found = [CardChoice("Send … here", f"Send {{asset}} to {name}.")]
    if name in world.gates:
        if "uav" in kinds:
            found.append(CardChoice("Look", f"Send a drone to look at {name}."))
        if "ugv" in kinds:
            found.append(CardChoice("Block", f"Let {{{PLAIN_KINDS['ugv']}}} block {name}."))
        found.append(CardChoice("Report", f"Report on {name}."))
    return [*found, FOLLOW]


def asset_lines(asset: AssetTelemetry, links: Mapping[str, str], taken_by: str = "") -> list[str]:
    """Return the last report of an asset in lines; `links` are those of the picture.

    `taken_by` has taken manual control of it here, '' for nobody.
    """
    where = f"at {asset.at}" if asset.at else f"to {asset.post}" if asset.post else "between posts"
    over = link_in_words(asset.id, links)
    return [
        f"{KIND_WORDS[asset.kind]} {where}, {asset.task}",
        f"{asset.status}, battery {asset.battery_pct:.0f} %, link {asset.comms}",
        *([over] if over else []),
        *([f"MANUAL, taken by {taken_by}"] if taken_by else []),
        *(["MANUAL, by its own report"] if asset.manual and not taken_by else []),
    ]


def track_lines(track: Track) -> list[str]:
    """Return the sensors' evidence on a track in lines."""
    return [
        f"{track.identity} {track.kind}, intent {track.intent}",
        *([track.dispute] if track.dispute else []),
        f"{track.distance_m:.0f} m from {track.gate}, {track.status}",
    ]


class Card(ModalScreen[CardChoice | None]):
    """Returns the choice, or None. Choosing gives no command: an order is typed, not sent.

    Manual control alone is taken and given back at once: the console only sends less by that.
    """

    BINDINGS = [
        Binding("escape", "dismiss", "Back"),
        Binding("m", "manual", show=False),
        *(Binding(str(number), f"pick({number})", show=False) for number in range(1, 10)),
    ]

    def __init__(
        self,
        title: str,
        lines: Sequence[str],
        choices: Sequence[CardChoice],
        at: Offset | None = None,
    ) -> None:
        """`at` is the cell of the screen beside which it opens, None for the middle."""
        super().__init__()
        self._title, self._lines, self._choices, self._at = title, lines, choices, at

    def compose(self) -> ComposeResult:
        """Yield the facts and the choices."""
        with Vertical(id="card"):
            yield Static("\n".join(self._lines), id="card-lines", markup=False)
            yield OptionList(
                *(
                    Option(Content(f"{number} {choice.name}"))
                    for number, choice in enumerate(self._choices, start=1)
                ),
                id="card-choices",
                compact=True,
            )

    def on_mount(self) -> None:
        """Set the card's title and the effect of choosing."""
        card = self.query_one("#card", Vertical)
        card.border_title = Content(self._title)
        if any(choice.order and not choice.does for choice in self._choices):
            card.border_subtitle = "an order is typed; you send it"
        self.query_one("#card-lines").display = bool(self._lines)
        self.query_one(OptionList).focus()
        self._place()

    def on_resize(self) -> None:
        """Stay on the screen."""
        self._place()

    def _place(self) -> None:
        height = len(self._lines) + len(self._choices) + 2
        width, rows = self.app.size
        if self._at is None:
            x, y = (width - WIDTH) // 2, (rows - height) // 2
        else:
            x, y = self._at.x + 2, self._at.y + 1
        self.query_one("#card").styles.offset = (
            max(0, min(x, width - WIDTH)),
            max(0, min(y, rows - height)),
        )

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Return the choice."""
        event.stop()
        self.dismiss(self._choices[event.option_index])

    def on_click(self, event: events.Click) -> None:
        """Go back when the click is beside the card."""
        if event.widget is self:
            self.dismiss(None)

    def action_manual(self) -> None:
        """Take manual control of the asset, or give it back, if the card offers that."""
        offered = next((choice for choice in self._choices if choice.does == GIVE), None)
        if offered is not None:
            self.dismiss(offered)

    def action_pick(self, number: int) -> None:
        """Choose by the number of the line."""
        if number <= len(self._choices):
            self.dismiss(self._choices[number - 1])
