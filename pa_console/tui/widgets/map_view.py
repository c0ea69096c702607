"""The live map: only rows that changed are painted again."""

from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.tui.map.scene import ROLES, Scene

LEGEND = (
    ("◆", "covered", "gate-covered"), ("◇", "UNCOVERED", "gate-uncovered"),
    ("?", "unknown", "track-unknown"), ("!", "unauthorized", "track-unauthorized"),
    ("✔", "authorized", "track-authorized"), ("■", "vehicle", "legend"),
    ("▪", "person", "legend"), ("•", "route", "route"), ("╱", "restricted", "zone-label"),
)  # fmt: skip

LEGEND_FROM_ROWS = 13
"""A map with fewer rows needs them all."""


class MapView(Widget):
    """The checkpoint from above, with the last picture on it and a legend below."""

    can_focus = True
    COMPONENT_CLASSES = {f"map--{role}" for role in ROLES}

    def __init__(self, world: World, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"))
        self._scene = Scene(world)
        self._picture: Picture | None = None
        self._rows: list[list[tuple[str, str]]] = []
        self._styles: dict[str, Style] = {}
        self.border_title = "Map"

    def show(self, picture: Picture | None) -> None:
        """Show another picture; hidden, nothing is drawn until the map is seen again."""
        self._picture = picture
        if self.is_on_screen and self.content_size.height > 1:
            self._draw()

    def on_show(self) -> None:
        """Draw what was left out while the map was hidden."""
        self._draw()

    def on_resize(self, _event: events.Resize) -> None:
        """Draw for the new size."""
        self._draw()

    def notify_style_update(self) -> None:
        """Forget colours when the theme or the style sheet changes."""
        super().notify_style_update()
        self._styles = {}

    def _draw(self) -> None:
        width, height = self.content_size
        if width < 2 or height < 2:
            return
        room = height - 1 if height >= LEGEND_FROM_ROWS else height
        canvas = self._scene.draw(self._picture, width, room)
        rows = [canvas.runs(row) for row in range(room)]
        if room < height:
            rows.append(legend(width))
        if len(rows) != len(self._rows):
            self._rows = rows
            self.refresh()
            return
        changed = [Region(0, y, width, 1) for y, row in enumerate(rows) if row != self._rows[y]]
        self._rows = rows
        if changed:
            self.refresh(*changed)

    def render_line(self, y: int) -> Strip:
        """Return line `y` of the content."""
        if y >= len(self._rows):
            return Strip.blank(self.content_size.width, self.rich_style)
        segments = [Segment(text, self._style(role)) for text, role in self._rows[y]]
        return Strip(segments).adjust_cell_length(self.content_size.width, self.rich_style)

    def _style(self, role: str) -> Style:
        if role not in self._styles:
            self._styles[role] = (
                self.get_component_rich_style(f"map--{role}") if role else self.rich_style
            )
        return self._styles[role]

    def text(self) -> str:
        """Return the map as it is shown, as plain text."""
        return "\n".join("".join(text for text, _ in row) for row in self._rows)


def legend(width: int) -> list[tuple[str, str]]:
    """Return the meaning of the map's signs, as many as fit into `width` cells."""
    runs: list[tuple[str, str]] = []
    used = 0
    for glyph, word, role in LEGEND:
        gap = "  " if runs else " "
        if used + len(gap) + len(word) + 2 > width:
            break
        runs += [(gap, ""), (glyph, role), (f" {word}", "legend")]
        used += len(gap) + len(word) + 2
    return runs
