"""The live map, which repaints only changed rows; it can be zoomed and follow an item."""

from collections import deque
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from math import dist, hypot

from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.geometry import Offset, Region
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from pa_console.schema.base import Point
from pa_console.schema.events.session import ReportedContact
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import Background, World
from pa_console.tui.map.canvas import Canvas, Cell, Projection, Run
from pa_console.tui.map.plan_layer import PlanLayer
from pa_console.tui.map.scene import ROLES, MapScene, Sensors, Window
from pa_console.tui.plan_preview import PlanPreview
from pa_console.tui.refresh import retitle

TRAIL_S = 20.0
"""The length of a trail, in simulated seconds."""

GAP_S = 6.0
"""The longest gap between two pictures that a trail bridges, in seconds."""

STEP_M = 0.5
"""The minimum movement that extends a trail, in metres; less movement is position noise."""

MOST_THINGS = 200
"""The largest team with trails; more trails would cover the map."""

LEGEND = (
    ("⠤", "planned way", "ghost"), ("◎", "arrives", "arrival"), ("1→2", "guards", "gate-gains"),
    ("1→0", "guards", "gate-loses"),
    ("⠒", "camera's view", "camera-field"), ("⠂", "asset's view", "asset-field"),
    ("◇", "UNCOVERED", "gate-uncovered"), ("?", "cover unknown", "gate-unknown"),
    ("‼", "hostile", "track-hostile"), ("!", "unauthorized", "track-unauthorized"),
    ("?", "unknown", "track-unknown"), ("✔", "authorized", "track-authorized"),
    ("?", "not in view", "track-stale"), ("◌", "TAK, unverified", "contact"),
    ("?", "stale report", "stale"),
    ("⊕", "MANUAL", "manual"),
    ("≠", "suspect", "suspect"), ("✘", "down", "down"), ("▿✘", "camera failed", "camera-failed"),
    ("▿?", "camera unknown", "camera-unknown"), ("3", "assets here", "crowd"),
    ("◆", "covered", "gate-covered"), ("⠤", "route", "route"), ("⠂", "path so far", "trail"),
    ("▿", "camera", "camera"), ("╱", "restricted", "zone"),
)  # fmt: skip
"""The glyph, word and role of each sign; a sign is listed only while its role is on the map."""

LEGEND_FROM_ROWS = 13
"""The minimum height of a map with a legend, in rows."""

RIGHT_BUTTON = 3
MOST_ZOOM = 16.0
FOLLOW_ZOOM = 2.0
"""The minimum zoom when the map begins to follow an item."""

SCALES_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
SCALE_COLUMNS = 7
"""The approximate length of the scale bar, in columns."""

PAN_SHARE = 0.25
"""The share of the view that one step of panning moves."""


class Trails:
    """The latest positions of everything that moves."""

    def __init__(self) -> None:
        self._seen: dict[str, deque[tuple[float, Point]]] = {}
        self._time_s = 0.0

    def add(self, picture: Picture | None) -> None:
        """Add a picture; an earlier picture, or one after a long gap, starts all trails again."""
        time_s = picture.time_s if picture is not None else 0.0
        if not self._time_s <= time_s <= self._time_s + GAP_S:
            self._seen.clear()
        self._time_s = time_s
        if picture is None or len(picture.assets) > MOST_THINGS:
            return
        things = {**picture.assets, **picture.tracks}
        for name in self._seen.keys() - things.keys():
            del self._seen[name]
        for name, thing in things.items():
            seen = self._seen.setdefault(name, deque())
            if not seen or dist(seen[-1][1], thing.position) >= STEP_M:
                seen.append((time_s, thing.position))
            while len(seen) > 1 and seen[1][0] < time_s - TRAIL_S:
                seen.popleft()

    def __iter__(self) -> Iterator[list[Point]]:
        """Yield the trail of everything that has moved, oldest position first."""
        yield from ([point for _, point in seen] for seen in self._seen.values() if len(seen) > 1)


class MapView(Widget):
    """The checkpoint from above, with the last picture on it and a legend below."""

    can_focus = True
    COMPONENT_CLASSES = {f"map--{role}" for role in ROLES}

    @dataclass
    class Picked(Message):
        """Posted with the content of a clicked cell, tracks and assets first; it may be empty.

        `at` is the cell of the screen; `menu` is True for the right button.
        """

        names: tuple[str, ...]
        at: Offset
        menu: bool

    def __init__(self, world: World, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"))
        self._world = world
        self._scene = MapScene(world)
        self._picture: Picture | None = None
        self._contacts: tuple[ReportedContact, ...] = ()
        self._rows: list[list[Run]] = []
        self._canvas = Canvas(0, 0)
        self._view: Projection | None = None
        self._is_due = False
        self._styles: dict[str, Style] = {}
        self._zoom = 1.0
        self._centre: Point | None = None
        self._trails = Trails()
        self._sensors: Sensors = ""
        self._plan: PlanPreview | None = None
        self._moment_s: float | None = None
        self._fit = (0, 0)
        self._fit_for = (0, 0)
        self._fits: dict[tuple[tuple[int, int], int, int], bool] = {}
        self.followed = ""
        self.border_title = "Map"

    def show(
        self,
        picture: Picture | None,
        contacts: Collection[ReportedContact] = (),
        *,
        live: bool = False,
    ) -> None:
        """Show another picture; a hidden map is drawn only when it is seen again.

        `contacts` are reports by others. Trails are shown only if the session is `live`, because
        the view of a replay depends on its moment alone.
        """
        self._picture, self._contacts = picture, tuple(contacts)
        self._trails.add(picture if live else None)
        if self.is_on_screen and self.content_size.height > 1:
            self._draw_next()

    def lay(self, background: Background) -> None:
        """Use `background` beneath everything, in place of the world's own background."""
        self._scene.lay(background)

    def show_plan(self, plan: PlanPreview | None, moment_s: float | None = None) -> None:
        """Draw a plan that has not run over the picture, and dim everything else.

        With `moment_s`, show the picture of the rehearsal at that moment instead of the last
        picture.
        """
        if (plan, moment_s) == (self._plan, self._moment_s):
            return
        self._plan, self._moment_s = plan, moment_s
        self.set_class(plan is not None, "-plan")
        self.set_class(moment_s is not None, "-rehearsal")
        if self.is_on_screen:
            self._draw_next()

    def zoom_by(self, factor: float) -> None:
        """Multiply the zoom by `factor`; at 1, the whole site is shown."""
        self._zoom = min(max(self._zoom * factor, 1.0), MOST_ZOOM)
        if self._zoom <= 1.0:
            self._centre = None
        self._draw()

    def pan(self, right: int, up: int) -> None:
        """Move the view by a share of its size, and follow nothing any more."""
        if self._zoom > 1.0:
            west, south, east, north = self._whole
            x, y = self._centre or ((west + east) / 2, (south + north) / 2)
            x += right * PAN_SHARE * (east - west) / self._zoom
            y += up * PAN_SHARE * (north - south) / self._zoom
            self._centre = (min(max(x, west), east), min(max(y, south), north))
            self.followed = ""
            self._draw()

    def next_sensors(self) -> None:
        """Show the cameras' fields of view, then those of the assets too, then neither."""
        order: tuple[Sensors, ...] = ("", "cameras", "all")
        self._sensors = order[(order.index(self._sensors) + 1) % len(order)]
        self._draw()

    def follow(self, name: str) -> bool:
        """Keep an asset, track, camera or frame in view and point at it; '' follows nothing.

        Returns whether there is an item of that name.
        """
        place = self._place_of(name)
        self.followed = name if place is not None else ""
        if place is not None:
            self._zoom = max(self._zoom, FOLLOW_ZOOM)
            self._centre = place
        self._draw()
        return place is not None

    def _place_of(self, name: str) -> Point | None:
        picture, world = self._picture, self._world
        if picture is not None and (item := picture.tracks.get(name) or picture.assets.get(name)):
            return item.position
        fixed = world.cameras.get(name) or world.frames.get(name)
        return fixed.at if fixed is not None else None

    @property
    def _whole(self) -> tuple[float, float, float, float]:
        return Projection(self._world, 2, 20).whole

    def _window(self) -> Window:
        """Return the window to show; it moves if a followed item leaves the middle of the view."""
        place = self._place_of(self.followed) if self.followed else None
        if self._zoom > 1.0 and place is not None:
            west, south, east, north = self._whole
            x, y = self._centre or place
            far_x = abs(place[0] - x) > (east - west) / self._zoom / 4
            if far_x or abs(place[1] - y) > (north - south) / self._zoom / 4:
                self._centre = place
        return self._zoom, self._centre

    def _fit_of(self, width: int, height: int) -> tuple[int, int]:
        """Return the size that sets the scale: the largest since the terminal was last resized.

        When a pane opens, the map therefore keeps its scale and loses the surroundings of the site,
        unless a frame would then be out of sight.
        """
        if self._fit_for != self.app.size:
            self._fit, self._fit_for = (width, height), self.app.size
        self._fit = max(self._fit[0], width), max(self._fit[1], height)
        shown = self._fit, width, height
        if shown not in self._fits:
            view = Projection(self._world, width, height, fit=self._fit)
            self._fits[shown] = all(view.shows(frame.at) for frame in self._world.frames.values())
        return self._fit if self._fits[shown] else (width, height)

    def _label(self) -> None:
        title = "Map"
        if self._zoom > 1.0:
            title += f" ×{self._zoom:g}"
        if self.followed:
            title += f" following {self.followed}"
        if plan := self._plan:
            title += f": {plan.reading}" if plan.reading else ": the plan that waits"
        if plan and self._moment_s is not None:
            title += f" · REHEARSAL {self._moment_s:.0f} s of {plan.duration_s:.0f} s"
        retitle(self, title)

    def on_show(self) -> None:
        """Draw the changes that were left out while the map was hidden."""
        self._draw()

    def on_resize(self, _event: events.Resize) -> None:
        """Draw for the new size."""
        self._draw()

    def notify_style_update(self) -> None:
        """Reset the colours when the theme or the style sheet changes."""
        super().notify_style_update()
        self._styles = {}

    def _draw_next(self) -> None:
        """Draw in the next message, when all changes of this frame are known."""
        if not self._is_due:
            self._is_due = True
            self.call_next(self._draw)

    def _draw(self) -> None:
        self._is_due = False
        self._label()
        width, height = self.content_size
        if width < 2 or height < 2:
            return
        room = height - 1 if height >= LEGEND_FROM_ROWS else height
        window, fit = self._window(), self._fit_of(width, room)
        picture, layer, trails = self._picture, None, self._trails
        contacts = self._contacts
        if self._plan is not None:
            layer = PlanLayer(self._plan, self._scene.short, self._moment_s or 0.0)
        if self._plan is not None and self._moment_s is not None:
            picture, trails = self._plan.picture_at(self._moment_s), ()
            contacts = ()
        canvas = self._scene.draw(
            picture, width, room, window, self.followed,
            trails=trails, sensors=self._sensors, plan=layer, fit=fit, contacts=contacts,
        )  # fmt: skip
        rows = [canvas.runs(row) for row in range(room)]
        self._canvas, self._view = canvas, Projection(self._world, width, room, *window, fit)
        if room < height:
            scale = self._view.columns_per_metre
            rows.append(legend(width, {role for row in rows for _, role in row}, scale))
        if len(rows) != len(self._rows):
            self._rows = rows
            self.refresh()
            return
        changed = [Region(0, y, width, 1) for y, row in enumerate(rows) if row != self._rows[y]]
        self._rows = rows
        if changed:
            self.refresh(*changed)

    def on_click(self, event: events.Click) -> None:
        """Post the content of the clicked cell."""
        place = event.get_content_offset(self)
        if place is not None and event.chain == 1:
            names = self.names_at((place.x, place.y))
            if names or event.button == RIGHT_BUTTON:
                menu = event.button == RIGHT_BUTTON
                self.post_message(self.Picked(names, event.screen_offset, menu=menu))

    def names_at(self, cell: Cell) -> tuple[str, ...]:
        """Return the content of a cell: items with a marker or name there, and then the frames."""
        canvas = self._canvas
        names = dict.fromkeys(canvas.marks.get(cell, ()))
        for at, written in canvas.labels.items():
            if any(cell in cells for cells in written):
                names.update(dict.fromkeys(canvas.marks[at]))
        if self._view is not None and canvas.holds(cell):
            x, y = self._view.centre(cell)
            line = "".join(canvas.glyphs[cell[1]])
            for name, frame in self._world.frames.items():
                away = hypot(frame.at[0] - x, frame.at[1] - y)
                written = line.rfind(name, 0, cell[0] + len(name))
                on_name = written >= 0 and written <= cell[0] < written + len(name)
                if on_name or self._view.cell(frame.at) == cell or away <= frame.radius_m:
                    names[name] = None
        return tuple(names)

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


def legend(width: int, roles: set[str], columns_per_metre: float) -> list[Run]:
    """Return the scale and as many legend entries for `roles` as fit into `width`."""
    bar = scale_bar(columns_per_metre)
    runs: list[Run] = [(f" {bar}", "legend")]
    used = 1 + len(bar)
    for glyph, word, role in LEGEND:
        if role not in roles:
            continue
        length = 2 + len(glyph) + 1 + len(word)
        if used + length > width:
            break
        runs += [("  ", ""), (glyph, role), (f" {word}", "legend")]
        used += length
    return runs


def scale_bar(columns_per_metre: float) -> str:
    """Return a bar of a round length, with its length in metres."""
    metres = min(SCALES_M, key=lambda metres: abs(metres * columns_per_metre - SCALE_COLUMNS))
    columns = max(round(metres * columns_per_metre), 2)
    return f"├{'─' * (columns - 2)}┤ {metres} m"
