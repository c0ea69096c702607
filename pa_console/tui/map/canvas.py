"""A grid of character cells with a role each; roles become colours where the map is shown."""

from dataclasses import dataclass, field
from itertools import pairwise

Cell = tuple[int, int]
"""(column, row), row 0 at the top."""

NORTH, EAST, SOUTH, WEST = 1, 2, 4, 8

_WALLS = {
    0: " ", NORTH: "┃", SOUTH: "┃", NORTH | SOUTH: "┃", EAST: "━", WEST: "━", EAST | WEST: "━",
    EAST | SOUTH: "┏", WEST | SOUTH: "┓", NORTH | EAST: "┗", NORTH | WEST: "┛",
    NORTH | SOUTH | EAST: "┣", NORTH | SOUTH | WEST: "┫", EAST | WEST | SOUTH: "┳",
    EAST | WEST | NORTH: "┻", NORTH | EAST | SOUTH | WEST: "╋",
}  # fmt: skip


@dataclass
class Canvas:
    """Glyphs and roles of `width` x `height` cells; what is drawn later lies on top."""

    width: int
    height: int
    glyphs: list[list[str]] = field(init=False)
    roles: list[list[str]] = field(init=False)
    walls: dict[Cell, int] = field(default_factory=dict[Cell, int])

    def __post_init__(self) -> None:
        self.glyphs = [[" "] * self.width for _ in range(self.height)]
        self.roles = [[""] * self.width for _ in range(self.height)]

    def copy(self) -> "Canvas":
        """Return an independent copy."""
        twin = Canvas(0, 0)
        twin.width, twin.height, twin.walls = self.width, self.height, self.walls
        twin.glyphs = [row.copy() for row in self.glyphs]
        twin.roles = [row.copy() for row in self.roles]
        return twin

    def holds(self, cell: Cell) -> bool:
        """Whether the cell lies on the canvas."""
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

    def add_wall(self, start: Cell, end: Cell) -> None:
        """Add a wall; corners and crossings get their proper box-drawing glyphs."""
        path = staircase(start, end)
        for here, there in pairwise(path):
            out, back = _directions(here, there)
            self.walls[here] = self.walls.get(here, 0) | out
            self.walls[there] = self.walls.get(there, 0) | back

    def draw_walls(self, role: str) -> None:
        """Draw all walls added so far."""
        for cell, bits in self.walls.items():
            self.put(cell, _WALLS[bits], role)

    def lines(self) -> list[str]:
        """Return the glyphs as text."""
        return ["".join(row) for row in self.glyphs]

    def runs(self, row: int) -> list[tuple[str, str]]:
        """Return a row as (text, role) runs."""
        result: list[tuple[str, str]] = []
        glyphs, roles = self.glyphs[row], self.roles[row]
        start = 0
        for column in range(1, self.width + 1):
            if column == self.width or roles[column] != roles[start]:
                result.append(("".join(glyphs[start:column]), roles[start]))
                start = column
        return result


def _directions(here: Cell, there: Cell) -> tuple[int, int]:
    if there[0] != here[0]:
        return (EAST, WEST) if there[0] > here[0] else (WEST, EAST)
    return (SOUTH, NORTH) if there[1] > here[1] else (NORTH, SOUTH)


def straight(start: Cell, end: Cell) -> list[Cell]:
    """Return the cells of a straight line, one a column or row, both ends included."""
    columns, rows = end[0] - start[0], end[1] - start[1]
    count = max(abs(columns), abs(rows))
    if count == 0:
        return [start]
    return [
        (start[0] + round(columns * i / count), start[1] + round(rows * i / count))
        for i in range(count + 1)
    ]


def staircase(start: Cell, end: Cell) -> list[Cell]:
    """Return the cells of a line whose neighbours share an edge, so that walls stay closed."""
    result: list[Cell] = []
    for cell in straight(start, end):
        if result and cell[0] != result[-1][0] and cell[1] != result[-1][1]:
            result.append((cell[0], result[-1][1]))
        result.append(cell)
    return result
