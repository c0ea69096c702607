"""Batteries: drained by standing and moving, filled at the base, empty at last (CAP-04)."""

from pa_console.schema.world import World
from pa_console.sim.state import Scene


def drain(world: World, scene: Scene, dt_s: float) -> None:
    """Take one step's charge from every battery; a charging asset gains until it is full."""
    minutes = dt_s / 60.0
    for asset in scene.assets.values():
        if asset.battery <= 0.0 or asset.failed:
            continue
        platform = world.platforms[asset.kind]
        if asset.task == "charging":
            asset.battery = min(100.0, asset.battery + platform.charge_pct_per_min * minutes)
            if asset.battery >= 100.0:
                asset.task = "idle"
            continue
        moving = asset.speed > 0.0
        rate = platform.drain_moving_pct_per_min if moving else platform.drain_idle_pct_per_min
        asset.battery = max(0.0, asset.battery - rate * minutes)
