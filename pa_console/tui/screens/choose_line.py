"""Chooses one of many lines, narrowed by words that are typed: orders, or things on the map."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from pa_console.schema.text import visible_line
from pa_console.tui.status_words import NOTE, QUIET
from pa_console.tui.widgets.fields import LineField
from pa_console.tui.widgets.row_views import VirtualRows

PLAIN_HINT = "↑ ↓ point · Enter chooses · Esc goes back"


class ChoiceLine(NamedTuple):
    """A choice, and the note beside it."""

    text: str
    note: str = ""


class LineRows(VirtualRows):
    """A row a line; the pointer is shown while the field above has the keys."""

    can_focus = False

    def __init__(self, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._notes: dict[str, str] = {}

    def show(self, lines: Sequence[ChoiceLine]) -> None:
        """Show these lines; the pointer stays on its line, or goes to the first."""
        self._notes = dict(lines)
        self.set_keys(list(self._notes))

    def row(self, index: int, width: int) -> Content:
        """Return a line with its note at the right, which goes first when room is short."""
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
    """Returns the text of the line that was chosen, or None; nothing else happens here."""

    BINDINGS = [
        Binding("escape", "dismiss", "Back"),
        Binding("up", "point(-1)", "Line above", priority=True),
        Binding("down", "point(1)", "Line below", priority=True),
        Binding("delete", "remove", "Remove the favourite at the pointer", priority=True),
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
        """Show the lines; `nothing` is shown when there is none.

        `more` yields all lines anew, more of them each time; it runs in a thread. `remove` takes a
        line away and returns the rest; it raises ValueError or OSError.
        """
        super().__init__()
        self._title, self._lines, self._nothing = title, list(lines), nothing
        self._more, self._remove = more, remove
        self._reads = more is not None

    def compose(self) -> ComposeResult:
        """Yield the field, the list and what can be done."""
        with Vertical(id="choose"):
            yield LineField(id="choose-words", placeholder="type any words of it")
            yield LineRows(id="choose-list")
            yield Static(id="choose-note", markup=False)

    def on_mount(self) -> None:
        """Start in the field."""
        self.query_one("#choose").border_title = Content(self._title)
        self.query_one(Input).focus()
        self._show()
        if self._more is not None:
            self.run_worker(self._read, thread=True, group="lines", exit_on_error=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Leave the delete key to the field where no line can be removed, or words are typed."""
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
        found = [line for line in self._lines if all(word in line.text.lower() for word in words)]
        self.query_one(LineRows).show(found)
        note = self.query_one("#choose-note", Static)
        if found:
            keys = PLAIN_HINT + (" · Del removes it" if self._remove else "")
            note.update("reading earlier sessions …" if self._reads else keys)
        else:
            none = "nothing has these words" if words else self._nothing
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
        """Go back when the click is beside the list."""
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
