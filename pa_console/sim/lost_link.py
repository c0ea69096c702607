"""What a device does when it hears nothing from the station any more (CAP-05)."""

from pa_console.sim import devices, link, power, radio
from pa_console.sim.state import AssetState, Scene
from pa_console.sim.terrain import Terrain


def listen(terrain: Terrain, scene: Scene) -> None:
    """Let every device take in the station's heartbeat, sent once a telemetry period.

    One that has heard nothing for its platform's `lost_link_after_s` ends its command and holds
    or returns to base. Once it hears the station again it tells how its command ended.
    """
    world = terrain.world
    for asset in scene.assets.values():
        if radio.works(scene, asset) and not radio.loses(scene, asset):
            heard(terrain, scene, asset)
        elif not asset.cut_off and not asset.down:
            silence_s = (scene.tick - asset.heard_tick) * world.dt_s
            if silence_s >= world.platforms[asset.kind].lost_link_after_s:
                asset.cut_off = True
                power.rouse(world, scene, asset)
                asset.owes = (*asset.owes, *devices.lose_link(terrain, scene, asset))


def heard(terrain: Terrain, scene: Scene, asset: AssetState) -> None:
    """Note that something from the station has just reached `asset`."""
    asset.heard_tick = scene.tick
    if asset.cut_off:
        owes, asset.cut_off, asset.owes = asset.owes, False, ()
        for reply in owes:
            link.send_reply(scene, reply, terrain.world.dt_s)
