"""The fixed part of the map: background, lanes, zones, walls and frames.

Walls and the edges of the site and of zones are barriers: no name may lie on or beyond one.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from shapely import Polygon, contains_xy

from pa_console.schema.base import Point
from pa_console.schema.world import OCCUPIED_CELL, Background, World
from pa_console.tui.map.canvas import Blocks, Canvas, Cell, Projection, Spot, Strokes, touched

Line = tuple[Spot, Spot]

FRAME_GLYPHS = {"gate": "◆", "post": "○", "base": "⌂"}
_COST = {
    "": 0,
    "background": 1,
    "lane": 2,
    "zone": 3,
    "leader": 20,
    "wall": 40,
    "frame": 60,
    "label": 60,
}
_CROWDED = 10
"""The maximum number of frames in a view that shows every name, even one that hides something."""

_NO_PLACE = 40.0


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
        """Return a byte for each cell of each row of the view: 1 if a barrier touches the cell."""
        return [row.copy() for row in self._rows]

    def __contains__(self, cell: Cell) -> bool:
        """Return whether a barrier touches the cell."""
        return cell in self._lines

    def part(self, spot: Spot, cell: Cell, beside: Cell) -> bool:
        """Return whether a barrier in `cell` lies between `spot` and the middle of `beside`."""
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


@dataclass(frozen=True)
class MapGround:
    """A view of a world without anything that moves, and the places for the names of frames."""

    view: Projection
    canvas: Canvas
    barriers: Barriers
    names: dict[str, Cell]
    """The cell where the name of each frame begins; in a crowded view, some frames have none."""


def draw_ground(world: World, view: Projection, background: Background | None) -> MapGround:
    """Draw everything that does not move, on top of the `background`.

    The names of frames are placed, but not written.
    """
    canvas = Canvas(view.width, view.height)
    barriers = Barriers(world, view)
    edges, lanes, walls = Strokes(), Strokes(), Blocks()
    if background is not None:
        _shade(canvas, view, background)
    for zone in world.zones.values():
        _hatch(canvas, view, barriers, zone.polygon)
        edges.path([view.spot(point) for point in (*zone.polygon, zone.polygon[0])])
    edges.draw(canvas, "zone")
    for lane in world.lanes.values():
        lanes.path([view.spot(point) for point in lane.points], period=3)
    lanes.draw(canvas, "lane")
    for wall in world.walls:
        walls.line(view.spot(wall.start), view.spot(wall.end))
    walls.draw(canvas, "wall")
    for frame in world.frames.values():
        canvas.put(view.cell(frame.at), FRAME_GLYPHS[frame.kind], "frame")
    for name, zone in world.zones.items():
        column, row = view.cell(_middle(zone.polygon))
        start = column - len(name) // 2 - 1
        cells = [(start + offset, row) for offset in range(len(name) + 2)]
        if all(canvas.holds(cell) and cell not in barriers for cell in cells):
            canvas.write((start, row), f" {name} ", "zone-label")
    return MapGround(view, canvas, barriers, _names(world, view, canvas.copy()))


def _names(world: World, view: Projection, canvas: Canvas) -> dict[str, Cell]:
    """Return the cell for the name of each frame, where the name hides least."""
    centre = view.cell(_middle(world.perimeter))
    shown = {name: frame for name, frame in world.frames.items() if view.shows(frame.at)}
    most = _NO_PLACE if len(shown) > _CROWDED else None
    names: dict[str, Cell] = {}
    for name, frame in shown.items():
        at = _place_name(canvas, view.cell(frame.at), name, away_from=centre, most=most)
        if at is not None:
            canvas.write(at, name, "label")
            names[name] = at
    return names


def _place_name(
    canvas: Canvas, cell: Cell, text: str, *, away_from: Cell, most: float | None = None
) -> Cell | None:
    """Return the cell beside `cell` where a name hides least, preferably away from the centre.

    Returns None if every cell costs `most` or more.
    """
    column, row = cell
    outward = (column > away_from[0]) - (column < away_from[0])
    down = (row > away_from[1]) - (row < away_from[1])
    middle = column - len(text) // 2
    candidates = [
        ((column + 2, row), 0 if outward >= 0 else 4),
        ((column - len(text) - 1, row), 0 if outward < 0 else 4),
        ((middle, row - 1), 1 if down < 0 else 5),
        ((middle, row + 1), 1 if down > 0 else 5),
        ((column + 2, row - 1), 2 if down < 0 else 6),
        ((column + 2, row + 1), 2 if down > 0 else 6),
        ((column - len(text) - 1, row - 1), 3 if down < 0 else 7),
        ((column - len(text) - 1, row + 1), 3 if down > 0 else 7),
    ]
    costs = [(cost + _hidden(canvas, at, len(text)), at) for at, cost in candidates]
    least, best = min(costs, key=lambda item: item[0])
    return None if most is not None and least >= most else best


def _hidden(canvas: Canvas, start: Cell, length: int) -> int:
    """Return the cost of a text at `start`: the cells it would hide, and the letters cut off."""
    cells = [(start[0] + offset, start[1]) for offset in range(-1, length + 1)]
    inside = [cell for cell in cells if canvas.holds(cell)]
    lost = 100 * (len(cells) - len(inside))
    return lost + sum(_COST.get(canvas.role(cell), 60) for cell in inside)


def _hatch(canvas: Canvas, view: Projection, barriers: Barriers, polygon: Sequence[Point]) -> None:
    """Hatch the cells in a polygon that no barrier touches."""
    corners = [view.cell(point) for point in polygon]
    columns = range(
        max(min(c[0] for c in corners), 0), min(max(c[0] for c in corners) + 1, canvas.width)
    )
    rows = range(
        max(min(c[1] for c in corners), 0), min(max(c[1] for c in corners) + 1, canvas.height)
    )
    area = Polygon(polygon)
    for row in rows:
        for column in columns:
            cell = column, row
            if cell not in barriers and contains_xy(area, *view.centre(cell)):
                canvas.put(cell, "╱", "zone")


def _shade(canvas: Canvas, view: Projection, background: Background) -> None:
    """Shade the occupied cells of a robot's map.

    Every occupied cell is drawn, so that a view of the whole site omits none. If the cells of the
    view are smaller, each of them is tested as well, so that a near view has no gaps.
    """
    (west, south), cell_m = background.origin, background.cell_m
    for number, row in enumerate(reversed(background.rows)):
        north = south + (number + 0.5) * cell_m
        for cell in re.finditer(OCCUPIED_CELL, row):
            canvas.put(view.cell((west + (cell.start() + 0.5) * cell_m, north)), "▒", "background")
    if view.columns_per_metre * cell_m > 1.0:
        for line in range(canvas.height):
            for column in range(canvas.width):
                if background.is_occupied(view.centre((column, line))):
                    canvas.put((column, line), "▒", "background")


def _middle(points: Sequence[Point]) -> Point:
    return (
        (min(p[0] for p in points) + max(p[0] for p in points)) / 2,
        (min(p[1] for p in points) + max(p[1] for p in points)) / 2,
    )
