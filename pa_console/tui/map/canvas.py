"""A grid of character cells with a role each; roles become colours where the map is shown."""

from dataclasses import dataclass, field

Cell = tuple[int, int]
"""(column, row), row 0 at the top."""

Spot = tuple[float, float]
"""(column, row) finer than a cell: the cell (3, 2) reaches from (3.0, 2.0) up to (4.0, 3.0)."""

Run = tuple[str, str]
"""(text, role)"""

FREE = frozenset(("", "lane", "zone", "asset-field", "camera-field", "trail", "route"))
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
