"""Finds the ground assets near a moving one without asking every asset of a team at every step.

Who is near is looked up with some metres to spare and holds until somebody has gone half of them
(a Verlet list), so most steps look nothing up.
"""

import math
from collections.abc import Iterable, Set
from typing import NamedTuple

from pa_console.sim.state.scene import AssetState

_HOLDS_M = 2.0
"""A result holds until an asset has moved this far, metres."""
_SPARE_M = 2 * _HOLDS_M + 0.01
_FEW = 16
"""Up to this number, assets are compared one by one instead of by cells."""

_Cell = tuple[int, int]


class Neighbours(NamedTuple):
    """The neighbours that a ground asset may give way to or touch; some are farther off.

    It holds until an asset has moved `until_m` metres since the traffic began.
    """

    near: list[AssetState]
    close: list[AssetState]
    until_m: float


class Traffic:
    """The ground assets of a team; nobody but those that `went` tells of may have moved."""

    def __init__(
        self, assets: Iterable[AssetState], standing_m: float, moving_m: float, close_m: float
    ) -> None:
        """Search `assets` within the distances for standing and for moving neighbours.

        They are close within `close_m`.
        """
        self._standing_m, self._moving_m = standing_m + _SPARE_M, moving_m + _SPARE_M
        self._close_m = close_m + _SPARE_M
        self._cell_m = max(self._moving_m, self._close_m) + _SPARE_M
        self._moving: set[str] = set()
        self._ground = [asset for asset in assets if asset.kind != "uav"]
        self._gone_m = self._sorted_until_m = 0.0
        self._cells: dict[_Cell, list[AssetState]] = {}
        self._neighbours: dict[str, Neighbours] = {}
        self.waiting: dict[str, tuple[object, ...] | None] = {}
        """The situation in which an asset found no way: in an equal one there is none either."""

    def went(self, metres: float) -> None:
        """Note that in this step no asset has moved more than `metres`."""
        self._gone_m += metres

    def go(self, names: Set[str]) -> None:
        """Note that in this step only assets of these names may move."""
        if not names <= self._moving:
            self._moving = set(names)
            self._neighbours.clear()

    def around(self, asset: AssetState) -> Neighbours:
        """Return the neighbours of `asset`."""
        found = self._neighbours.get(asset.id)
        if found is None or self._gone_m > found.until_m:
            found = self._neighbours[asset.id] = self._look_up(asset)
        return found

    def _look_up(self, asset: AssetState) -> Neighbours:
        found = Neighbours([], [], self._gone_m + _HOLDS_M)
        x, y, widest_m = asset.x, asset.y, max(self._moving_m, self._close_m)
        for other in self._ground if len(self._ground) <= _FEW else self._in_cells(asset):
            gap = math.hypot(other.x - x, other.y - y)
            if gap > widest_m or other is asset:
                continue
            if gap <= (self._moving_m if other.id in self._moving else self._standing_m):
                found.near.append(other)
            if gap <= self._close_m:
                found.close.append(other)
        return found

    def _in_cells(self, asset: AssetState) -> Iterable[AssetState]:
        """Return those in the nine cells about `asset`; the cells hold as long as a list does."""
        if not self._cells or self._gone_m > self._sorted_until_m:
            self._cells = {}
            for other in self._ground:
                self._cells.setdefault(self._cell(other), []).append(other)
            self._sorted_until_m = self._gone_m + _HOLDS_M
        column, row = self._cell(asset)
        return [
            other
            for i in (column - 1, column, column + 1)
            for j in (row - 1, row, row + 1)
            for other in self._cells.get((i, j), ())
        ]

    def _cell(self, asset: AssetState) -> _Cell:
        return math.floor(asset.x / self._cell_m), math.floor(asset.y / self._cell_m)
