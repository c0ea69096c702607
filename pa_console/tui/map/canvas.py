"""A grid of character cells with a role each, and lines on it that are finer than a cell.

Roles become colours where the map is shown. Lines are quarters of a cell as blocks, or eighths
of it as braille dots.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil, floor

Cell = tuple[int, int]
"""(column, row), row 0 at the top."""

Spot = tuple[float, float]
"""(column, row) finer than a cell: the cell (3, 2) reaches from (3.0, 2.0) up to (4.0, 3.0)."""

Run = tuple[str, str]
"""(text, role)"""

FREE = frozenset(
    ("", "background", "lane", "zone", "asset-field", "camera-field", "trail", "route")
)
"""The roles of cells where something else may be drawn."""


@dataclass
class Canvas:
    """Glyphs and roles of `width` x `height` cells; what is drawn later lies on top.

    `marks` says which assets and tracks a cell's marker stands for, and `labels` where the leader
    and the names of the marker in a cell are.
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
        """Draw one cell; outside the canvas nothing happens."""
        if self.holds(cell):
            self.glyphs[cell[1]][cell[0]] = glyph
            self.roles[cell[1]][cell[0]] = role

    def write(self, cell: Cell, text: str, role: str) -> None:
        """Draw a text from `cell` to the right."""
        for offset, glyph in enumerate(text):
            self.put((cell[0] + offset, cell[1]), glyph, role)

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
    """Collects dots of a grid of 2 x 4 in each cell, to be drawn as one braille glyph each."""

    BITS: Sequence[Sequence[int]] = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
    """The bit of each dot in a cell, by row and column."""

    GLYPHS: Sequence[str] = "".join(chr(0x2800 + bits) for bits in range(256))

    def __init__(self) -> None:
        self._cells: dict[Cell, int] = defaultdict(int)

    def line(self, start: Spot, end: Spot, *, period: int = 1, on: int = 1) -> None:
        """Add a straight line; of `period` dots in a row the first `on` are drawn."""
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
        """Draw all dots, in cells of a role in `over` only, if any is given."""
        for cell, bits in self._cells.items():
            if canvas.holds(cell) and (not over or canvas.role(cell) in over):
                canvas.put(cell, self.GLYPHS[bits], role)


class Blocks(Strokes):
    """The same with solid quarters of a cell, for what must not look thin."""

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
