"""Batteries: drained by standing and moving, filled at the base, empty at last (CAP-04).

A battery is brought up to date only when its rate changes or its state is reported, so an asset
that stands idle costs nothing in between.
"""

from pa_console.schema.world import World
from pa_console.sim.state.scene import AssetState, Scene


def rouse(world: World, scene: Scene, asset: AssetState) -> None:
    """Add `asset` to those that every step looks after, until it is idle again."""
    settle(world, scene, asset)
    scene.active.add(asset.id)
    asset.said = None


def settle(world: World, scene: Scene, asset: AssetState) -> None:
    """Bring the battery up to date; a charging asset gains until it is full and then is idle."""
    minutes = (scene.tick - asset.settled_tick) * world.dt_s / 60.0
    asset.settled_tick = scene.tick
    before = asset.battery
    if minutes <= 0.0 or asset.failed or before <= 0.0:
        return
    platform = world.platforms[asset.kind]
    if asset.task == "charging":
        asset.battery = min(100.0, before + platform.charge_pct_per_min * minutes)
        if asset.battery >= 100.0:
            asset.task, asset.said = "idle", None
        return
    moving = asset.speed > 0.0
    rate = platform.drain_moving_pct_per_min if moving else platform.drain_idle_pct_per_min
    after = before - rate * minutes
    if after > 0.0:
        asset.battery = after
        return
    asset.battery, asset.said = 0.0, None
    scene.active.add(asset.id)
