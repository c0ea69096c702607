"""Screens that lead to an order: a list narrowed by typed words, and the card of a map item."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.content import Content
from textual.geometry import Offset
from textual.screen import ModalScreen
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from pa_console.schema.events.event import CameraStill
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.text import visible_line
from pa_console.schema.world import PLAIN_KINDS, World
from pa_console.session.wording import link_in_words
from pa_console.tui.order_templates import forms_for
from pa_console.tui.status_words import KIND_WORDS, NOTE, QUIET
from pa_console.tui.widgets.fields import LineField
from pa_console.tui.widgets.row_views import VirtualRows
from pa_console.tui.widgets.still import STILL_ROWS, ReadStill, StillView

PLAIN_HINT = "↑ ↓ move · Enter selects · Esc goes back"

WIDTH = 46
"""The width of a card, in cells; its height depends on its content."""

GIVE = "give"
"""The effect of a choice that sends its order at once; such an order moves no asset."""


class ChoiceLine(NamedTuple):
    """A choice, and the note beside it."""

    text: str
    note: str = ""


class LineRows(VirtualRows):
    """The lines to choose from; the pointer is shown while the field above has the focus."""

    can_focus = False

    def __init__(self, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._notes: dict[str, str] = {}

    def show(self, lines: Sequence[ChoiceLine]) -> None:
        """Show these lines; the pointer stays on its line, or goes to the first."""
        self._notes = dict(lines)
        self.set_keys(list(self._notes))

    def row(self, index: int, width: int) -> Content:
        """Return a line with its note at the right; the note is dropped first if room is short."""
        key = self.keys[index]
        pointed, note = key == self.cursor, self._notes[key]
        text = Content.styled(visible_line(key), "bold" if pointed else "")
        room = width - 2
        if note and room - len(note) >= room // 2:
            room -= len(note) + 2
            text = text.truncate(room, ellipsis=True, pad=True)
            text = Content.assemble(text, "  ", (note, QUIET))
        else:
            text = text.truncate(room, ellipsis=True)
        return Content.assemble(("▸ ", f"bold {NOTE}") if pointed else "  ", text)


class ChooseLine(ModalScreen[str | None]):
    """A list that returns the text of the chosen line, or None."""

    BINDINGS = [
        Binding("escape", "dismiss", "Back"),
        Binding("up", "point(-1)", "Line above", priority=True),
        Binding("down", "point(1)", "Line below", priority=True),
        Binding("delete", "remove", "Remove the selected favourite", priority=True),
    ]

    def __init__(
        self,
        title: str,
        lines: Sequence[ChoiceLine],
        *,
        nothing: str,
        more: Callable[[], Iterator[list[ChoiceLine]]] | None = None,
        remove: Callable[[str], list[ChoiceLine]] | None = None,
    ) -> None:
        """Show the lines, or the text `nothing` if there are none.

        `more` runs in a thread and yields the whole list several times, each time with more lines.
        `remove` removes a line and returns the others; it raises ValueError or OSError on failure.
        """
        super().__init__()
        self._title, self._lines, self._nothing = title, list(lines), nothing
        self._more, self._remove = more, remove
        self._reads = more is not None

    def compose(self) -> ComposeResult:
        """Yield the field, the list and the hint."""
        with Vertical(id="choose"):
            yield LineField(id="choose-words", placeholder="type any words to search for")
            yield LineRows(id="choose-list")
            yield Static(id="choose-note", markup=False)

    def on_mount(self) -> None:
        """Focus the field, and begin to read more lines."""
        self.query_one("#choose").border_title = Content(self._title)
        self.query_one(Input).focus()
        self._show()
        if self._more is not None:
            self.run_worker(self._read, thread=True, group="lines", exit_on_error=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Leave the delete key to the field if no line can be removed or if the field has text."""
        if action == "remove":
            return self._remove is not None and not self.query_one(Input).value
        return super().check_action(action, parameters)

    def _read(self) -> None:
        assert self._more is not None
        try:
            for lines in self._more():
                if not self.is_attached:
                    return
                self.app.call_from_thread(self._take, lines)
        finally:
            if self.is_attached:
                self.app.call_from_thread(self._take, None)

    def _take(self, lines: list[ChoiceLine] | None) -> None:
        if not self.is_attached:
            return
        if lines is None:
            self._reads = False
        else:
            self._lines = lines
        self._show()

    def _show(self) -> None:
        words = self.query_one(Input).value.lower().split()
        matches = [line for line in self._lines if all(word in line.text.lower() for word in words)]
        self.query_one(LineRows).show(matches)
        note = self.query_one("#choose-note", Static)
        if matches:
            keys = PLAIN_HINT + (" · Del removes it" if self._remove else "")
            note.update("reading earlier sessions …" if self._reads else keys)
        else:
            none = "no entry has these words" if words else self._nothing
            note.update("reading earlier sessions …" if self._reads else none)

    @on(Input.Changed)
    def _typed(self, event: Input.Changed) -> None:
        event.stop()
        self.query_one(LineRows).cursor = ""
        self._show()

    @on(Input.Submitted)
    def _entered(self, event: Input.Submitted) -> None:
        event.stop()
        if cursor := self.query_one(LineRows).cursor:
            self.dismiss(cursor)

    @on(VirtualRows.RowChosen)
    def _chosen(self, event: VirtualRows.RowChosen) -> None:
        event.stop()
        self.dismiss(event.key)

    def on_click(self, event: events.Click) -> None:
        """Go back if the click is beside the list."""
        if event.widget is self:
            self.dismiss(None)

    def action_point(self, by: int) -> None:
        """Move the pointer."""
        self.query_one(LineRows).action_cursor(by)

    def action_remove(self) -> None:
        """Remove the line at the pointer."""
        cursor = self.query_one(LineRows).cursor
        if self._remove is None or not cursor:
            return
        try:
            self._lines = self._remove(cursor)
        except (ValueError, OSError) as error:
            self.notify(str(error), title="Favourites", severity="error", markup=False)
        self._show()


class CardChoice(NamedTuple):
    """A line of a card: it types `order`, sends it at once, or has the effect `does`."""

    name: str
    order: str = ""
    does: str = ""


FOLLOW = CardChoice("Follow on the map", does="follow")
MAP_CHOICES = (
    CardChoice("Zoom in", does="zoom_in"),
    CardChoice("Zoom out", does="zoom_out"),
    CardChoice("Fields of view", does="sensors"),
)
"""The choices for an empty place on the map."""


def asset_choices(asset: AssetTelemetry, *, taken: bool) -> list[CardChoice]:
    """Return the choices for this asset; a failed asset can only be followed.

    An asset under manual control takes no orders. If it was `taken` here, it can be given back.
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
    """Return the choices for a track: the orders that the team can carry out, or to follow it."""
    kinds = {spec.kind for spec in world.assets.values()}
    choices: list[CardChoice] = []
    if "uav" in kinds:
        choices.append(CardChoice("Look at it", f"Send a drone to look at {track.gate}."))
    if "robot" in kinds:
        about = f"{track.id} at {track.gate}"
        choices.append(CardChoice("Identify it", f"Send a robot to identify {about}."))
        if track.identity != "authorized":
            choices.append(CardChoice("Warn it", f"Send a robot to warn {about}."))
    return [*choices, FOLLOW]


def frame_choices(name: str, world: World) -> list[CardChoice]:
    """Return the choices for a place: the orders that the team can carry out, or to follow it."""
    kinds = {spec.kind for spec in world.assets.values()}
    choices = [CardChoice("Send … here", f"Send {{asset}} to {name}.")]
    if name in world.gates:
        if "uav" in kinds:
            choices.append(CardChoice("Look", f"Send a drone to look at {name}."))
        if "ugv" in kinds:
            choices.append(CardChoice("Block", f"Let {{{PLAIN_KINDS['ugv']}}} block {name}."))
        choices.append(CardChoice("Report", f"Report on {name}."))
    return [*choices, FOLLOW]


def asset_lines(asset: AssetTelemetry, picture: Picture, taken_by: str = "") -> list[str]:
    """Return the lines with the last report of an asset in `picture`.

    `taken_by` is the operator who has taken manual control of it here, '' for none.
    """
    where = f"at {asset.at}" if asset.at else f"to {asset.post}" if asset.post else "between posts"
    over = link_in_words(asset.id, picture.links)
    why = picture.not_ready.get(asset.id)
    return [
        f"{KIND_WORDS[asset.kind]} {where}, {asset.task}",
        f"{asset.status}, battery {asset.charge}, link {asset.comms}",
        *([f"not ready: {why}"] if why else []),
        *([over] if over else []),
        *([f"MANUAL, taken by {taken_by}"] if taken_by else []),
        *(["MANUAL, by its own report"] if asset.manual and not taken_by else []),
    ]


def track_lines(track: Track) -> list[str]:
    """Return the lines with the sensors' evidence on a track."""
    return [
        f"{track.identity} {track.kind}, intent {track.intent}",
        *([track.dispute] if track.dispute else []),
        f"{track.distance_m:.0f} m from {track.gate}, {track.status}",
    ]


class Card(ModalScreen[CardChoice | None]):
    """The card of an asset, a track or a place; it returns the choice, or None.

    A chosen order is typed, not sent. The exception is manual control, which is taken and given
    back at once and moves no asset.
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
        read_still: ReadStill = lambda _: None,
    ) -> None:
        """Open the card beside the cell `at` of the screen; None means the middle.

        `read_still` returns the file of a still.
        """
        super().__init__()
        self._still = StillView(read_still)
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
            yield self._still

    def on_mount(self) -> None:
        """Set the card's title and the effect of choosing."""
        card = self.query_one("#card", Vertical)
        card.border_title = Content(self._title)
        if any(choice.order and not choice.does for choice in self._choices):
            card.border_subtitle = "types an order, which you then send"
        self.query_one("#card-lines").display = bool(self._lines)
        self.query_one(OptionList).focus()
        self._place()

    def on_resize(self) -> None:
        """Keep the card on the screen."""
        self._place()

    def show_still(self, still: CameraStill, now_s: float) -> None:
        """Show a still below the choices, or its problem above them."""
        if still.problem:
            self._lines = [*self._lines, f"{still.camera}, no still: {still.problem}"]
            self.query_one("#card-lines", Static).update("\n".join(self._lines))
        self._still.tell_age(now_s)
        self._still.show(still)
        self._place()

    def _place(self) -> None:
        height = len(self._lines) + len(self._choices) + 2
        if self._still.has_room:
            height += STILL_ROWS
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
        """Go back if the click is beside the card."""
        if event.widget is self:
            self.dismiss(None)

    def action_manual(self) -> None:
        """Take manual control of the asset, or give it back, if the card offers that."""
        offered = next((choice for choice in self._choices if choice.does == GIVE), None)
        if offered is not None:
            self.dismiss(offered)

    def action_pick(self, number: int) -> None:
        """Choose a line by its number."""
        if number <= len(self._choices):
            self.dismiss(self._choices[number - 1])
