"""Lines finer than a cell: quarters of a cell as blocks, eighths of it as braille dots."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from math import ceil, floor

from pa_console.tui.map.canvas import Canvas, Cell, Spot


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
