"""Finds the assets near a point without asking every asset of a large team."""

import math
from collections.abc import Iterable

from pa_console.sim.state import AssetState


class Neighbours:
    """Assets by square cell of `cell_m` metres, as they stand when it is built."""

    def __init__(self, assets: Iterable[AssetState], cell_m: float) -> None:
        self._cell_m = cell_m
        self._cells: dict[tuple[int, int], list[AssetState]] = {}
        for asset in assets:
            key = (math.floor(asset.x / cell_m), math.floor(asset.y / cell_m))
            self._cells.setdefault(key, []).append(asset)

    def near(self, x: float, y: float) -> list[AssetState]:
        """Return every asset within `cell_m` of the point, and some farther ones."""
        column, row = math.floor(x / self._cell_m), math.floor(y / self._cell_m)
        found: list[AssetState] = []
        for i in (column - 1, column, column + 1):
            for j in (row - 1, row, row + 1):
                found += self._cells.get((i, j), ())
        return found
