"""A grid of character cells, each with a role, and the projection from metres to its cells.

The map widget turns roles into colours. Lines are finer than a cell: they consist of quarters of a
cell, drawn as blocks, or of eighths, drawn as braille dots. A cell is about twice as tall as wide.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, pairwise
from math import ceil, floor

from pa_console.schema.base import Point
from pa_console.schema.world import World

Cell = tuple[int, int]
"""The column and row of a cell; row 0 is at the top."""

Spot = tuple[float, float]
"""A column and row with fractions: cell (3, 2) extends from (3.0, 2.0) up to (4.0, 3.0)."""

Run = tuple[str, str]
"""A text and its role."""

FREE = frozenset(
    ("", "background", "lane", "zone", "asset-field", "camera-field", "trail", "route")
)
"""The roles of cells where something else may be drawn."""

CELL_ASPECT = 2.0
MOST_STRETCH = 1.7
"""The largest factor by which the site is widened to fill a wide pane."""

LOW_STRETCH = 3.4
"""The same factor on a low map, where room for names matters more than the site's shape."""

LANE_SHARE = 0.14
"""The margin around the site in which lanes are shown, as a share of the site's size."""

LANES_FROM_ROWS = 12
"""The minimum height of a map with a margin for lanes; a lower map uses it for the site."""


@dataclass
class Canvas:
    """The glyphs and roles of `width` x `height` cells; later drawings are on top.

    `marks` maps each cell with a marker to its assets and tracks. `labels` maps the cell of a
    marker to the cells of its leaders and names.
    """

    width: int
    height: int
    glyphs: list[list[str]] = field(init=False)
    roles: list[list[str]] = field(init=False)
    marks: dict[Cell, tuple[str, ...]] = field(default_factory=dict[Cell, tuple[str, ...]])
    labels: dict[Cell, list[list[Cell]]] = field(default_factory=dict[Cell, list[list[Cell]]])

    def __post_init__(self) -> None:
        self.glyphs = [[" "] * self.width for _ in range(self.height)]
        self.roles = [[""] * self.width for _ in range(self.height)]

    def copy(self) -> "Canvas":
        """Return an independent copy of the drawing and the marks, without names."""
        twin = Canvas(0, 0)
        twin.width, twin.height = self.width, self.height
        twin.glyphs = [row.copy() for row in self.glyphs]
        twin.roles = [row.copy() for row in self.roles]
        twin.marks = self.marks
        return twin

    def holds(self, cell: Cell) -> bool:
        """Return whether the cell lies on the canvas."""
        return 0 <= cell[0] < self.width and 0 <= cell[1] < self.height

    def put(self, cell: Cell, glyph: str, role: str) -> None:
        """Draw one cell; do nothing outside the canvas."""
        if self.holds(cell):
            self.glyphs[cell[1]][cell[0]] = glyph
            self.roles[cell[1]][cell[0]] = role

    def write(self, cell: Cell, text: str, role: str) -> None:
        """Draw a text from `cell` to the right."""
        for offset, glyph in enumerate(text):
            self.put((cell[0] + offset, cell[1]), glyph, role)

    def at(self, cell: Cell) -> Run:
        """Return the glyph and the role of a cell."""
        return self.glyphs[cell[1]][cell[0]], self.roles[cell[1]][cell[0]]

    def role(self, cell: Cell) -> str:
        """Return the role of a cell."""
        return self.roles[cell[1]][cell[0]]

    def lines(self) -> list[str]:
        """Return the glyphs as text."""
        return ["".join(row) for row in self.glyphs]

    def runs(self, row: int) -> list[Run]:
        """Return a row as (text, role) runs."""
        result: list[Run] = []
        glyphs, roles = self.glyphs[row], self.roles[row]
        start = 0
        for column in range(1, self.width + 1):
            if column == self.width or roles[column] != roles[start]:
                result.append(("".join(glyphs[start:column]), roles[start]))
                start = column
        return result


class Strokes:
    """Dots on a grid of 2 x 4 in each cell; each cell is drawn as one braille glyph."""

    BITS: Sequence[Sequence[int]] = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
    """The bit of each dot in a cell, by row and column."""

    GLYPHS: Sequence[str] = "".join(chr(0x2800 + bits) for bits in range(256))

    def __init__(self) -> None:
        self._cells: dict[Cell, int] = defaultdict(int)

    def line(self, start: Spot, end: Spot, *, period: int = 1, on: int = 1) -> None:
        """Add a straight line; the first `on` of every `period` dots are drawn."""
        cells, bits, down = self._cells, self.BITS, len(self.BITS)
        x, y = start[0] * 2, start[1] * down
        far_x, far_y = end[0] * 2 - x, end[1] * down - y
        count = max(ceil(max(abs(far_x), abs(far_y))), 1)
        step_x, step_y = far_x / count, far_y / count
        for first in range(on):
            for step in range(first, count + 1, period):
                column, row = floor(x + step_x * step), floor(y + step_y * step)
                cells[column // 2, row // down] |= bits[row % down][column % 2]

    def path(self, spots: Iterable[Spot], *, period: int = 1, on: int = 1) -> None:
        """Add the lines from each spot to the next."""
        for start, end in pairwise(spots):
            self.line(start, end, period=period, on=on)

    def draw(self, canvas: Canvas, role: str, over: Sequence[str] | frozenset[str] = ()) -> None:
        """Draw all dots; if `over` is given, draw only in cells whose role is in `over`."""
        for cell, bits in self._cells.items():
            if canvas.holds(cell) and (not over or canvas.role(cell) in over):
                canvas.put(cell, self.GLYPHS[bits], role)


class Blocks(Strokes):
    """Strokes drawn with solid quarter-cell blocks, for lines that must not look thin."""

    BITS = ((1, 2), (4, 8))
    GLYPHS = " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"


def touched(start: Spot, end: Spot, width: int, height: int) -> Iterator[Cell]:
    """Yield every cell of a `width` x `height` canvas that a straight line touches."""
    shares = {0.0, 1.0}
    for (a, b), most in zip(zip(start, end, strict=True), (width, height), strict=True):
        if a != b:
            low, high = max(ceil(min(a, b)), 0), min(floor(max(a, b)), most)
            shares.update((line - a) / (b - a) for line in range(low, high + 1))
    for before, after in pairwise(sorted(shares)):
        share = (before + after) / 2
        column = floor(start[0] + (end[0] - start[0]) * share)
        row = floor(start[1] + (end[1] - start[1]) * share)
        if 0 <= column < width and 0 <= row < height:
            yield column, row


@dataclass(frozen=True)
class Projection:
    """The projection of the site, and of its lanes if useful, to `width` x `height` cells.

    If `zoom` is above 1, only a part is shown, around `centre_on` (the middle if None). With `fit`,
    the scale is that of a view of that size, so a smaller view shows less of the site.
    """

    world: World
    width: int
    height: int
    zoom: float = 1.0
    centre_on: Point | None = None
    fit: tuple[int, int] | None = None

    @property
    def _fitted(self) -> tuple[int, int]:
        return self.fit or (self.width, self.height)

    @cached_property
    def _view(self) -> tuple[float, float, float, float]:
        """Return the west, south, east and north edges of the view, in metres."""
        west, south, east, north = self.whole
        if self.zoom <= 1.0:
            return west, south, east, north
        x, y = self.centre_on or ((west + east) / 2, (south + north) / 2)
        half_x, half_y = (east - west) / 2 / self.zoom, (north - south) / 2 / self.zoom
        return x - half_x, y - half_y, x + half_x, y + half_y

    @cached_property
    def whole(self) -> tuple[float, float, float, float]:
        """The west, south, east and north edges of the unzoomed view, in metres."""
        world = self.world
        site = list(
            chain(
                world.perimeter,
                (frame.at for frame in world.frames.values()),
                *((wall.start, wall.end) for wall in world.walls),
                *(zone.polygon for zone in world.zones.values()),
            )
        )
        west, east = min(p[0] for p in site), max(p[0] for p in site)
        south, north = min(p[1] for p in site), max(p[1] for p in site)
        reach_x = LANE_SHARE * (east - west)
        reach_y = LANE_SHARE * (north - south) if self._fitted[1] >= LANES_FROM_ROWS else 0.0
        far = [point for lane in world.lanes.values() for point in lane.points]
        return (
            max(west - reach_x, min([west, *(p[0] for p in far)])),
            max(south - reach_y, min([south, *(p[1] for p in far)])),
            min(east + reach_x, max([east, *(p[0] for p in far)])),
            min(north + reach_y, max([north, *(p[1] for p in far)])),
        )

    @cached_property
    def _middle(self) -> Point:
        west, south, east, north = self._view
        return (west + east) / 2, (south + north) / 2

    @cached_property
    def _scale(self) -> tuple[float, float]:
        """The number of cells per metre, across and down."""
        west, south, east, north = self._view
        width, height = self._fitted
        across = max(width - 3, 1) / max(east - west, 1.0)
        down = max(height - 1, 1) / max(north - south, 1.0)
        stretch = LOW_STRETCH if height < LANES_FROM_ROWS else MOST_STRETCH
        return (
            min(across, down * CELL_ASPECT * stretch),
            min(down, across / CELL_ASPECT * 1.2),
        )

    @cached_property
    def _centre(self) -> Spot:
        """The middle of the canvas; it is a whole number of cells away from the middle of `fit`."""
        width, height = self._fitted
        return width / 2 - (width - self.width) // 2, height / 2 - (height - self.height) // 2

    @property
    def columns_per_metre(self) -> float:
        """The number of columns for a metre from west to east."""
        return self._scale[0]

    def spot(self, point: Point) -> Spot:
        """Return the spot of a point in metres; it may lie outside the canvas."""
        (x, y), (across, down), (column, row) = self._middle, self._scale, self._centre
        return column + (point[0] - x) * across, row - (point[1] - y) * down

    def cell(self, point: Point) -> Cell:
        """Return the cell of a point in metres; it may lie outside the canvas."""
        column, row = self.spot(point)
        return floor(column), floor(row)

    def shows(self, point: Point) -> bool:
        """Return whether a point in metres lies on the canvas."""
        column, row = self.cell(point)
        return 0 <= column < self.width and 0 <= row < self.height

    def centre(self, cell: Cell) -> Point:
        """Return the point in metres at the centre of a cell."""
        return self.point((cell[0] + 0.5, cell[1] + 0.5))

    def point(self, spot: Spot) -> Point:
        """Return the point in metres at a spot of the canvas."""
        (x, y), (across, down), (column, row) = self._middle, self._scale, self._centre
        return x + (spot[0] - column) / across, y - (spot[1] - row) / down
