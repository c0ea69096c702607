"""The placement of names beside fixed markers; a leader connects a name that is farther away.

A name never hides a marker, and never lies on or beyond a wall or the edge of a zone.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import pairwise, product
from math import inf
from typing import NamedTuple

from pa_console.tui.map.canvas import Canvas, Cell, Run, Spot
from pa_console.tui.map.ground import Barriers

Block = Sequence[Sequence[Run]]
"""The lines of a name, one below the other."""

LONGEST_LEADER = 7
_LEADERS = {(1, 0): "─", (0, 1): "│", (1, 1): "╲", (1, -1): "╱"}
_TURNS = {
    ((0, 1), (1, 0)): "╰", ((0, 1), (-1, 0)): "╯", ((0, -1), (1, 0)): "╭", ((0, -1), (-1, 0)): "╮",
}  # fmt: skip
_HIDING = {
    "": 0.0, "lane": 0.2, "zone": 0.2, "asset-field": 0.1, "camera-field": 0.1, "trail": 0.1,
    "route": 0.4, "ghost": 0.4, "camera": 3.0,
}  # fmt: skip
_HIDING_ANYTHING_ELSE = 4.0
_TOUCHING = 0.8
"""The cost of a cell right beside another name or marker."""

_AMBIGUOUS = 1.5
"""The cost of another marker beside a leader, or below or above a name without a leader."""


_NEXT_TO_NOTHING = 2.0


class LabelPlacement(NamedTuple):
    """A way to write a block beside a marker at (0, 0), and its cost."""

    cost: float
    leader: tuple[Cell, ...]
    start: Cell


class Labels:
    """The names on one canvas; names that are placed earlier get better places."""

    def __init__(self, canvas: Canvas, barriers: Barriers) -> None:
        self._canvas, self._barriers = canvas, barriers
        self._taken = barriers.rows()
        self._kept_names = set[Cell]()
        for cell in canvas.marks:
            self.keep(cell)

    def keep(self, cell: Cell) -> None:
        """Protect a cell from being hidden by a name."""
        if self._canvas.holds(cell):
            self._taken[cell[1]][cell[0]] = 1

    def write(self, start: Cell, line: Sequence[Run], *, keep: bool = True) -> bool:
        """Write a line at `start`; return False if a marker or another name is in the way.

        With `keep`, no other name can hide the line. If the marker directly after the line is a
        number, the two would read as one. The line is then moved one cell to the left with `keep`,
        and is not written without it.
        """
        (column, row), width = start, sum(len(text) for text, _ in line)
        behind, taken = (column + width, row), self._canvas.marks.keys() | self._kept_names
        cells = [(column + n, row) for n in range(width)]
        if behind in self._canvas.marks and self._canvas.at(behind)[0].isdigit():
            column -= 1
            cells.insert(0, (column, row))
            if not keep or column < 0:
                return False
        if not taken.isdisjoint(cells):
            return False
        self._write_line((column, row), line)
        if keep:
            self._keep_name(cells)
        return True

    def _keep_name(self, cells: Sequence[Cell]) -> None:
        for cell in cells:
            self.keep(cell)
        self._kept_names.update(cells)

    def place(
        self, at: Cell, spots: Sequence[Spot], block: Block, gap: int = 0, most: float = inf
    ) -> list[Cell]:
        """Write `block` beside the marker in the cell `at`, whose assets are at `spots`.

        `gap` cells stay free between the marker and the name. The cost of the place must be below
        `most`. Returns the cells of the leader and the name; none if there was no room.
        """
        width, height = max(sum(len(text) for text, _ in line) for line in block), len(block)
        best, least = None, most
        for place in _places(width, height, gap):
            if place.cost >= least:
                break
            if self._free(at, place, width, height):
                cost = place.cost + self._cost(at, place, width, height)
                if cost < least and not self._parted(at, spots, place, width, height):
                    best, least = place, cost
        return [] if best is None else self._write(at, best, block, width)

    def extend(self, cells: list[Cell], text: str, role: str) -> None:
        """Add a text after a placed name, or before it, if the text hides almost nothing.

        The cells of the text are added to `cells`.
        """
        last = cells[-1]
        name = [
            cell for cell in cells if cell[1] == last[1] and self._canvas.role(cell) != "leader"
        ]
        for at, added in ((last[0] + 1, f" {text}"), (name[0][0] - len(text) - 1, f"{text} ")):
            place = LabelPlacement(0.0, (), (0, 0))
            free = self._free((at, last[1]), place, len(added), 1)
            if free and self._cost((at, last[1]), place, len(added), 1) < _NEXT_TO_NOTHING:
                cells += self._write((at, last[1]), place, [[(added, role)]], len(added))
                return

    def _free(self, at: Cell, place: LabelPlacement, width: int, height: int) -> bool:
        """Return whether a leader and a name fit on the canvas without hiding a kept cell."""
        (x, y), (right, down), taken = at, place.start, self._taken
        left, top = x + right, y + down
        columns, rows = self._canvas.width, self._canvas.height
        if left < 0 or top < 0 or left + width > columns or top + height > rows:
            return False
        for dx, dy in place.leader:
            if not (0 <= x + dx < columns and 0 <= y + dy < rows) or taken[y + dy][x + dx]:
                return False
        return all(taken[row].find(1, left, left + width) < 0 for row in range(top, top + height))

    def _cost(self, at: Cell, place: LabelPlacement, width: int, height: int) -> float:
        left, top = at[0] + place.start[0], at[1] + place.start[1]
        canvas, marks, cost = self._canvas, self._canvas.marks, 0.0
        for row in range(top, top + height):
            for role in canvas.roles[row][left : left + width]:
                cost += _HIDING.get(role, _HIDING_ANYTHING_ELSE)
            for beside in (left - 1, left + width):
                if 0 <= beside < canvas.width and (beside, row) != at:
                    cost += _TOUCHING * self._taken[row][beside]
        for x, y in place.leader:
            cell = at[0] + x, at[1] + y
            cost += _HIDING.get(canvas.role(cell), _HIDING_ANYTHING_ELSE)
            cost += _AMBIGUOUS * any(near in marks and near != at for near in _beside(cell))
        if not place.leader and not top <= at[1] < top + height:
            beside = ((column, at[1]) for column in range(left - 1, left + width + 1))
            cost += _AMBIGUOUS * sum(cell in marks and cell != at for cell in beside)
        return cost

    def _parted(
        self, at: Cell, spots: Sequence[Spot], place: LabelPlacement, width: int, height: int
    ) -> bool:
        """Return whether a barrier or a marker lies between the marker and its name."""
        left, top = at[0] + place.start[0], at[1] + place.start[1]
        way = [at, *((at[0] + x, at[1] + y) for x, y in place.leader)]
        way.append(_nearest(way[-1], left, top, width, height))
        if any(self._barriers.part(spot, at, way[1]) for spot in spots):
            return True
        crossed = {cell for step in pairwise(way) for cell in _corners(*step)} - {at}
        if any(cell in self._barriers for cell in crossed):
            return True
        return not place.leader and not crossed.isdisjoint(self._canvas.marks)

    def _write(self, at: Cell, place: LabelPlacement, block: Block, width: int) -> list[Cell]:
        cells = [(at[0] + x, at[1] + y) for x, y in place.leader]
        for before, cell, after in zip([at, *cells], cells, [*cells[1:], None], strict=False):
            self._canvas.put(cell, _leader_glyph(before, cell, after), "leader")
        left, top = at[0] + place.start[0], at[1] + place.start[1]
        for row, line in enumerate(block, start=top):
            self._write_line((left, row), line)
            cells += [(left + offset, row) for offset in range(width)]
        self._keep_name(cells)
        return cells

    def _write_line(self, start: Cell, line: Sequence[Run]) -> None:
        column, row = start
        for text, role in line:
            self._canvas.write((column, row), text, role)
            column += len(text)


def _leader_glyph(before: Cell, cell: Cell, after: Cell | None) -> str:
    came = cell[0] - before[0], cell[1] - before[1]
    goes = came if after is None else (after[0] - cell[0], after[1] - cell[1])
    if (came, goes) in _TURNS:
        return _TURNS[came, goes]
    return _LEADERS.get(came) or _LEADERS[-came[0], -came[1]]


def _nearest(cell: Cell, left: int, top: int, width: int, height: int) -> Cell:
    return min(max(cell[0], left), left + width - 1), min(max(cell[1], top), top + height - 1)


def _beside(cell: Cell) -> tuple[Cell, ...]:
    column, row = cell
    return (column - 1, row), (column + 1, row), (column, row - 1), (column, row + 1)


def _corners(here: Cell, there: Cell) -> Iterator[Cell]:
    """Yield every cell of the block between two cells."""
    for row in range(min(here[1], there[1]), max(here[1], there[1]) + 1):
        for column in range(min(here[0], there[0]), max(here[0], there[0]) + 1):
            yield column, row


@lru_cache(maxsize=256)
def _places(width: int, height: int, gap: int) -> tuple[LabelPlacement, ...]:
    """Return all ways to write a block of `width` x `height` cells, the best first."""
    return tuple(sorted(_all_places(width, height, gap)))


def _all_places(width: int, height: int, gap: int) -> Iterator[LabelPlacement]:
    for up in range(height):
        yield LabelPlacement(0.2 * up, (), (1 + gap, -up))
        yield LabelPlacement(0.1 + 0.2 * up, (), (-width - gap, -up))
    for right in range(-width, 2):
        cost = 1.0 + 0.1 * abs(right + width // 2)
        yield LabelPlacement(cost, (), (right, -height))
        yield LabelPlacement(cost + 0.1, (), (right, 1))
    for length in range(1, LONGEST_LEADER + 1):
        far = 1.6 + 0.5 * length
        for x, y in ((1, 0), (1, -1), (1, 1)):
            for side in (1, -1):
                leader = tuple((side * x * n, y * n) for n in range(1, length + 1))
                end = leader[-1]
                start = end[0] + 1 if side > 0 else end[0] - width
                for up in range(height):
                    yield LabelPlacement(far + 0.3 * bool(y), leader, (start, end[1] - up))
                    for more in range(1, LONGEST_LEADER) if y else ():
                        bent = *leader, *((end[0] + side * n, end[1]) for n in range(1, more + 1))
                        at = start + side * more, end[1] - up
                        yield LabelPlacement(far + 1.0 + 0.3 * more, bent, at)
        for y in (-1, 1):
            leader = tuple((0, y * n) for n in range(1, length + 1))
            row = leader[-1][1] - height if y < 0 else leader[-1][1] + 1
            for right in range(1 - width, 1):
                cost = 2 * far - 1.6 + 0.1 * abs(right + width // 2)
                yield LabelPlacement(cost, leader, (right, row))
            for more, side in product(range(1, LONGEST_LEADER), (1, -1)):
                bent = *leader, *((side * n, y * length) for n in range(1, more + 1))
                for up in range(height):
                    at = (more + 1 if side > 0 else -more - width), y * length - up
                    yield LabelPlacement(2 * far + 0.3 * more, bent, at)
