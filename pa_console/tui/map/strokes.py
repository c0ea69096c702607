"""Lines finer than a cell: quarters of a cell as blocks, eighths of it as braille dots."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from math import ceil, floor

from pa_console.tui.map.canvas import Canvas, Cell, Spot

_BRAILLE_BITS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
_QUARTERS = " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"


class Strokes:
    """Collects dots of a grid of `ACROSS` x `DOWN` in each cell, to be drawn as one glyph each."""

    ACROSS, DOWN = 2, 4

    def __init__(self) -> None:
        self._bits: dict[Cell, int] = defaultdict(int)

    def line(self, start: Spot, end: Spot, *, period: int = 1, on: int = 1) -> None:
        """Add a straight line; of `period` dots in a row the first `on` are drawn."""
        x, y = start[0] * self.ACROSS, start[1] * self.DOWN
        right, down = end[0] * self.ACROSS - x, end[1] * self.DOWN - y
        count = max(ceil(max(abs(right), abs(down))), 1)
        for step in range(count + 1):
            if step % period < on:
                self.dot(floor(x + right * step / count), floor(y + down * step / count))

    def path(self, spots: Iterable[Spot], *, period: int = 1, on: int = 1) -> None:
        """Add the lines from each spot to the next."""
        for start, end in pairwise(spots):
            self.line(start, end, period=period, on=on)

    def dot(self, x: int, y: int) -> None:
        """Add the dot in column `x` and row `y` of the fine grid."""
        self._bits[x // self.ACROSS, y // self.DOWN] |= self._bit(x, y)

    def _bit(self, x: int, y: int) -> int:
        return _BRAILLE_BITS[y % 4][x % 2]

    def _glyph(self, bits: int) -> str:
        return chr(0x2800 + bits)

    def draw(self, canvas: Canvas, role: str, over: Sequence[str] | frozenset[str] = ()) -> None:
        """Draw all dots, in cells of a role in `over` only, if any is given."""
        for cell, bits in self._bits.items():
            if canvas.holds(cell) and (not over or canvas.role(cell) in over):
                canvas.put(cell, self._glyph(bits), role)


class Blocks(Strokes):
    """The same with solid quarters of a cell, for what must not look thin."""

    ACROSS, DOWN = 2, 2

    def _bit(self, x: int, y: int) -> int:
        return 1 << (y % 2 * 2 + x % 2)

    def _glyph(self, bits: int) -> str:
        return _QUARTERS[bits]


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
