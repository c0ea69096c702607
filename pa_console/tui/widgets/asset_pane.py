"""The table of assets, tracks and cameras with the line in which a filter is typed."""

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.widgets import Input

from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.tui.refresh import retitle
from pa_console.tui.widgets.asset_table import AssetTable
from pa_console.tui.widgets.fields import LineField

PROBLEMS = "problem"
"""The word by which a filter finds what needs an eye."""


class AssetPane(Vertical):
    """Shows the table; a filter that is set is always named, so that nothing is missed unseen."""

    BINDINGS = [Binding("escape", "clear", "No filter", show=False)]

    def __init__(self, world: World, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"))
        self._world = world
        self._text = ""

    def compose(self) -> ComposeResult:
        """Yield the filter's line, hidden until it is used, and the table."""
        yield LineField(
            compact=True,
            id="asset-filter",
            placeholder="filter: uav, NorthGate, problem, stale, hostile, any text; Enter, Esc",
        )
        yield AssetTable(self._world, id="asset-rows")

    def on_mount(self) -> None:
        """Begin without a filter."""
        field = self.query_one("#asset-filter", Input)
        field.cursor_blink, field.display = False, False
        self._label()

    def show(self, picture: Picture | None) -> None:
        """Show another picture."""
        self.query_one(AssetTable).show(picture)
        self._label()

    def ask(self) -> None:
        """Let the operator type a filter."""
        field = self.query_one("#asset-filter", Input)
        field.display = True
        self.screen.set_focus(field)

    def toggle_problems(self) -> None:
        """Show only what needs an eye, or everything again."""
        self._set("" if self._text == PROBLEMS else PROBLEMS)

    @on(Input.Changed, "#asset-filter")
    def _typed(self, event: Input.Changed) -> None:
        event.stop()
        self._text = event.value.strip()
        self.query_one(AssetTable).filter(self._text)
        self._label()

    @on(Input.Submitted, "#asset-filter")
    def _done(self, event: Input.Submitted) -> None:
        event.stop()
        self._leave()

    def action_clear(self) -> None:
        """Take the filter away."""
        self._set("")
        self._leave()

    def _set(self, text: str) -> None:
        self.query_one("#asset-filter", Input).value = text

    def _leave(self) -> None:
        field = self.query_one("#asset-filter", Input)
        field.display = False
        if field.has_focus or self.has_focus_within:
            self.query_one(AssetTable).focus()

    def _label(self) -> None:
        count = self.query_one(AssetTable).count
        title = "Assets and tracks"
        if count.problems:
            verb = "needs" if count.problems == 1 else "need"
            title += f"  ▲ {count.problems} of {count.total} {verb} an eye"
        if self._text:
            title += f"  filter “{self._text}”: {count.shown} of {count.total}, Esc clears"
        retitle(self, title)
