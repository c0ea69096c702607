"""Draws what does not move: lanes, zones, walls, frames and their names."""

from collections.abc import Sequence
from itertools import pairwise

from pa_console.schema.base import Point
from pa_console.schema.world import World
from pa_console.tui.map.canvas import Canvas, Cell, straight
from pa_console.tui.map.projection import Projection

_FRAME_GLYPHS = {"gate": "◆", "post": "○", "base": "⌂"}
_COST = {"": 0, "lane": 2, "zone": 3, "wall": 40, "frame": 60, "label": 60}
_CROWDED = 10
"""With more frames than this, a name is left out where it would hide something."""


def draw_ground(world: World, view: Projection) -> tuple[Canvas, dict[str, Cell]]:
    """Return a canvas with everything that stays where it is, and where each frame's name is.

    In a crowded view a name that would hide something else is left out.
    """
    canvas = Canvas(view.width, view.height)
    for zone in world.zones.values():
        _hatch(canvas, view, zone.polygon)
    for lane in world.lanes.values():
        _dots(canvas, [view.cell(point) for point in lane.points])
    for wall in world.walls:
        canvas.add_wall(view.cell(wall.start), view.cell(wall.end))
    canvas.draw_walls("wall")
    for frame in world.frames.values():
        canvas.put(view.cell(frame.at), _FRAME_GLYPHS[frame.kind], "frame")
    centre = view.cell(_middle(world.perimeter))
    shown = {name: frame for name, frame in world.frames.items() if view.shows(frame.at)}
    most = 40.0 if len(shown) > _CROWDED else None
    labels: dict[str, Cell] = {}
    for name, frame in shown.items():
        at = place_label(canvas, view.cell(frame.at), name, "label", away_from=centre, most=most)
        if at is not None:
            labels[name] = at
    for name, zone in world.zones.items():
        cell = view.cell(_middle(zone.polygon))
        canvas.write((cell[0] - len(name) // 2 - 1, cell[1]), f" {name} ", "zone-label")
    return canvas, labels


def place_label(
    canvas: Canvas, cell: Cell, text: str, role: str, *, away_from: Cell, most: float | None = None
) -> Cell | None:
    """Write a name beside `cell` where it hides least, on the side away from the centre.

    Returns where; None when every place would hide `most` or more.
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
    if most is not None and least >= most:
        return None
    canvas.write(best, text, role)
    return best


def _hidden(canvas: Canvas, start: Cell, length: int) -> int:
    """Return how much a text of `length` cells at `start` would hide or lose."""
    cells = [(start[0] + offset, start[1]) for offset in range(-1, length + 1)]
    inside = [cell for cell in cells if canvas.holds(cell)]
    lost = 100 * (len(cells) - len(inside))
    return lost + sum(_COST.get(canvas.role(cell), 60) for cell in inside)


def _dots(canvas: Canvas, corners: Sequence[Cell]) -> None:
    for start, end in pairwise(corners):
        across = abs(end[0] - start[0]) > abs(end[1] - start[1])
        for count, cell in enumerate(straight(start, end)):
            if not (across and count % 2):
                canvas.put(cell, "·", "lane")


def _hatch(canvas: Canvas, view: Projection, polygon: Sequence[Point]) -> None:
    for row in range(canvas.height):
        for column in range(canvas.width):
            if inside(view.centre((column, row)), polygon):
                canvas.put((column, row), "╱", "zone")


def inside(point: Point, polygon: Sequence[Point]) -> bool:
    """Whether a point lies in a polygon (crossings of a ray to the east are odd)."""
    result = False
    for (x1, y1), (x2, y2) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        if (y1 > point[1]) != (y2 > point[1]):
            result ^= point[0] < x1 + (point[1] - y1) * (x2 - x1) / (y2 - y1)
    return result


def _middle(points: Sequence[Point]) -> Point:
    return (
        (min(p[0] for p in points) + max(p[0] for p in points)) / 2,
        (min(p[1] for p in points) + max(p[1] for p in points)) / 2,
    )
