"""Finds room on the map for what stands for assets, tracks and cameras."""

from collections.abc import Iterator
from functools import lru_cache

from pa_console.tui.map.canvas import Canvas, Cell
from pa_console.tui.map.tokens import Token

FREE = frozenset(("", "lane", "zone", "route"))
_SPARED = frozenset(("wall", "frame", "gate-covered", "gate-uncovered", "gate-unknown"))
_TAKEN_COST = 50.0


class Placer:
    """Writes tokens on one canvas, each as near to its true cell as room allows."""

    def __init__(self, canvas: Canvas) -> None:
        self._canvas = canvas
        self._taken: set[Cell] = set()

    def place(self, at: Cell, token: Token, *, over_walls: bool = False) -> None:
        """Write a token; names give way to it, other tokens do not."""
        canvas, (text, role) = self._canvas, token
        width = len(text)
        column = min(max(at[0], 1), canvas.width - width + 1)
        row = min(max(at[1], 0), canvas.height - 1)
        best, least = (column - 1, row), 1e9
        for distance, dx, dy in _near():
            if distance >= least:
                break
            start, line = column - 1 + dx, row + dy
            if start < 0 or start + width > canvas.width or not 0 <= line < canvas.height:
                continue
            cells = [(start + offset, line) for offset in range(width)]
            cost = distance + sum(self._cost(cell, over_walls) for cell in cells)
            if cost < least:
                best, least = cells[0], cost
        canvas.write(best, text, role)
        self._taken.update((best[0] + offset, best[1]) for offset in range(-1, width + 1))

    def _cost(self, cell: Cell, over_walls: bool) -> float:
        if cell in self._taken:
            return _TAKEN_COST
        role = self._canvas.role(cell)
        if role in FREE or (over_walls and role == "wall"):
            return 0.0
        return 2.5 if role in _SPARED else 0.8


@lru_cache(maxsize=1)
def _near() -> tuple[tuple[float, int, int], ...]:
    """Offsets around a cell, nearest first; a row counts as two columns."""
    return tuple(sorted(_offsets()))


def _offsets() -> Iterator[tuple[float, int, int]]:
    for dy in range(-2, 3):
        for dx in range(-7, 8):
            yield (abs(dx) / 2 + abs(dy)) * 1.2, dx, dy
