"""The projection from metres to character cells, which are about twice as tall as wide."""

from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from math import floor

from pa_console.schema.base import Point
from pa_console.schema.world import World
from pa_console.tui.map.canvas import Cell, Spot

CELL_ASPECT = 2.0
MOST_STRETCH = 1.7
"""The largest widening of the plan, so that it fills a wide pane."""

LANE_SHARE = 0.14
"""The share of the site's size that the view reaches beyond it along the lanes."""

LANES_FROM_ROWS = 12
"""A lower map is needed for the site itself."""


@dataclass(frozen=True)
class Projection:
    """Fits the site, and its lanes as far as useful, into `width` x `height` cells.

    With `zoom` above 1 only that part of it is shown, around `centre` (the middle if None). The
    scale is that of a view of the size `fit`, if one is given: a smaller view then shows less.
    """

    world: World
    width: int
    height: int
    zoom: float = 1.0
    centre_on: Point | None = None
    fit: tuple[int, int] | None = None

    @property
    def _fitted(self) -> tuple[int, int]:
        return self.fit or (self.width, self.height)

    @cached_property
    def _view(self) -> tuple[float, float, float, float]:
        """Return the west, south, east and north edge of the view, in metres."""
        west, south, east, north = self.whole
        if self.zoom <= 1.0:
            return west, south, east, north
        x, y = self.centre_on or ((west + east) / 2, (south + north) / 2)
        half_x, half_y = (east - west) / 2 / self.zoom, (north - south) / 2 / self.zoom
        return x - half_x, y - half_y, x + half_x, y + half_y

    @cached_property
    def whole(self) -> tuple[float, float, float, float]:
        """West, south, east and north edge of everything, in metres."""
        world = self.world
        site = list(
            chain(
                world.perimeter,
                (frame.at for frame in world.frames.values()),
                *((wall.start, wall.end) for wall in world.walls),
                *(zone.polygon for zone in world.zones.values()),
            )
        )
        west, east = min(p[0] for p in site), max(p[0] for p in site)
        south, north = min(p[1] for p in site), max(p[1] for p in site)
        reach_x = LANE_SHARE * (east - west)
        reach_y = LANE_SHARE * (north - south) if self._fitted[1] >= LANES_FROM_ROWS else 0.0
        far = [point for lane in world.lanes.values() for point in lane.points]
        return (
            max(west - reach_x, min([west, *(p[0] for p in far)])),
            max(south - reach_y, min([south, *(p[1] for p in far)])),
            min(east + reach_x, max([east, *(p[0] for p in far)])),
            min(north + reach_y, max([north, *(p[1] for p in far)])),
        )

    @cached_property
    def _middle(self) -> Point:
        west, south, east, north = self._view
        return (west + east) / 2, (south + north) / 2

    @cached_property
    def _scale(self) -> tuple[float, float]:
        """Cells per metre, across and down."""
        west, south, east, north = self._view
        width, height = self._fitted
        across = max(width - 3, 1) / max(east - west, 1.0)
        down = max(height - 1, 1) / max(north - south, 1.0)
        return (
            min(across, down * CELL_ASPECT * MOST_STRETCH),
            min(down, across / CELL_ASPECT * 1.2),
        )

    @cached_property
    def _centre(self) -> Spot:
        """The middle of the canvas; that of a smaller one is whole cells off that of `fit`."""
        width, height = self._fitted
        return width / 2 - (width - self.width) // 2, height / 2 - (height - self.height) // 2

    @property
    def columns_per_metre(self) -> float:
        """The number of columns of the canvas for a metre, from west to east."""
        return self._scale[0]

    def spot(self, point: Point) -> Spot:
        """Return where on the canvas a point in metres is; it may lie outside."""
        (x, y), (across, down), (column, row) = self._middle, self._scale, self._centre
        return column + (point[0] - x) * across, row - (point[1] - y) * down

    def cell(self, point: Point) -> Cell:
        """Return the cell of a point in metres; it may lie outside the canvas."""
        column, row = self.spot(point)
        return floor(column), floor(row)

    def shows(self, point: Point) -> bool:
        """Return whether a point in metres lies on the canvas."""
        column, row = self.cell(point)
        return 0 <= column < self.width and 0 <= row < self.height

    def centre(self, cell: Cell) -> Point:
        """Return the point in metres that a cell's centre stands for."""
        return self.point((cell[0] + 0.5, cell[1] + 0.5))

    def point(self, spot: Spot) -> Point:
        """Return the point in metres that a spot on the canvas stands for."""
        (x, y), (across, down), (column, row) = self._middle, self._scale, self._centre
        return x + (spot[0] - column) / across, y - (spot[1] - row) / down
