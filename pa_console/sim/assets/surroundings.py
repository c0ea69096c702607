"""Finds the ground assets near a moving one without asking every asset of a large team."""

import numpy as np
import numpy.typing as npt

from pa_console.sim.state import AssetState, Scene

Floats = npt.NDArray[np.float64]


class Traffic:
    """The ground assets of one step, before anything moves; collected on first use."""

    def __init__(self, scene: Scene, standing_m: float, moving_m: float) -> None:
        """Look `standing_m` far for those that stand and `moving_m` for those under way."""
        self._scene = scene
        self._standing_m, self._moving_m = standing_m, moving_m
        self._ground: list[AssetState] | None = None
        self._x: Floats = np.empty(0)
        self._y: Floats = np.empty(0)
        self._reach: Floats = np.empty(0)

    def near(self, asset: AssetState) -> list[AssetState]:
        """Return the ground assets that may matter to `asset`, itself among them."""
        ground = self._ground
        if ground is None:
            ground = [other for other in self._scene.assets.values() if other.kind != "uav"]
            moving = np.array([bool(other.route) or other.speed > 0.0 for other in ground])
            self._ground = ground
            self._x = np.array([other.x for other in ground])
            self._y = np.array([other.y for other in ground])
            self._reach = np.where(moving, self._moving_m**2, self._standing_m**2)
        dx, dy = self._x - asset.x, self._y - asset.y
        found: list[int] = np.flatnonzero(dx * dx + dy * dy <= self._reach).tolist()
        return [ground[index] for index in found]
