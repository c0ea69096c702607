"""Finds the ground assets near a point without asking every asset of a large team."""

import math
from collections.abc import Iterable

from pa_console.sim.state import AssetState, Scene


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


class Traffic:
    """The ground assets of one step, before anything moves; sorted into cells on first use."""

    def __init__(self, scene: Scene, standing_m: float, moving_m: float) -> None:
        """Look `standing_m` far for those that stand and `moving_m` for those under way."""
        self._scene = scene
        self._reach = (standing_m, moving_m)
        self._grids: tuple[Neighbours, Neighbours] | None = None

    def near(self, asset: AssetState) -> list[AssetState]:
        """Return the ground assets that may matter to `asset`, which is among them."""
        if self._grids is None:
            ground = [other for other in self._scene.assets.values() if other.kind != "uav"]
            standing = (other for other in ground if not other.route and not other.speed)
            moving = (other for other in ground if other.route or other.speed)
            self._grids = (
                Neighbours(standing, self._reach[0]),
                Neighbours(moving, self._reach[1]),
            )
        standing_by, under_way = self._grids
        return standing_by.near(asset.x, asset.y) + under_way.near(asset.x, asset.y)
