"""The barriers on the map that no name may lie on or beyond: walls, edges of site and zones."""

from collections import defaultdict
from collections.abc import Iterator

from pa_console.schema.base import Point
from pa_console.schema.world import World
from pa_console.tui.map.canvas import Cell, Spot
from pa_console.tui.map.projection import Projection
from pa_console.tui.map.strokes import touched

Line = tuple[Spot, Spot]


class Barriers:
    """The barriers of a view, by the cells that they touch."""

    def __init__(self, world: World, view: Projection) -> None:
        self._lines: dict[Cell, list[Line]] = defaultdict(list)
        for start, end in _edges(world):
            line = view.spot(start), view.spot(end)
            for cell in touched(*line, view.width, view.height):
                self._lines[cell].append(line)
        self._rows = [bytearray(view.width) for _ in range(view.height)]
        for column, row in self._lines:
            self._rows[row][column] = 1

    def rows(self) -> list[bytearray]:
        """Return for each row of the view a byte for each cell: 1 where a barrier touches it."""
        return [row.copy() for row in self._rows]

    def __contains__(self, cell: Cell) -> bool:
        """Return whether a barrier touches the cell."""
        return cell in self._lines

    def part(self, spot: Spot, cell: Cell, beside: Cell) -> bool:
        """Whether a barrier in `cell` runs between a spot in it and the middle of one `beside`."""
        lines = self._lines.get(cell)
        if not lines:
            return False
        middle = beside[0] + 0.5, beside[1] + 0.5
        return any(_cross(spot, middle, *line) for line in lines)


def _edges(world: World) -> Iterator[tuple[Point, Point]]:
    for wall in world.walls:
        yield wall.start, wall.end
    for polygon in (world.perimeter, *(zone.polygon for zone in world.zones.values())):
        yield from zip(polygon, (*polygon[1:], polygon[0]), strict=True)


def _side(start: Spot, end: Spot, spot: Spot) -> float:
    return (end[0] - start[0]) * (spot[1] - start[1]) - (end[1] - start[1]) * (spot[0] - start[0])


def _cross(a: Spot, b: Spot, c: Spot, d: Spot) -> bool:
    """Return whether the line from a to b meets the one from c to d; touching counts."""
    apart = _side(a, b, c) * _side(a, b, d) > 0.0
    return not (apart or _side(c, d, a) * _side(c, d, b) > 0.0)
