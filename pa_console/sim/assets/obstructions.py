"""Things that come to lie across the ground: nobody knows of them until an asset runs into one."""

from pa_console.schema.incident import Incident, ObstructWay
from pa_console.schema.world import Wall
from pa_console.sim.assets.physics import gap
from pa_console.sim.state.scene import AssetState, Scene
from pa_console.sim.worlds.terrain import Terrain

THICKNESS_M = 0.8
SEEN_M = 3.0
"""A ground asset that cannot go on has seen what lies this near to its hull."""


def apply(terrain: Terrain, scene: Scene, incident: Incident) -> bool:
    """Put an obstruction on the ground; return whether `incident` was about one.

    Raises ValueError when it has no length or would lie on a ground asset.
    """
    if not isinstance(incident, ObstructWay):
        return False
    if incident.start == incident.end:
        raise ValueError("the obstruction's start and end are the same point")
    wall = Wall(start=incident.start, end=incident.end, thickness_m=THICKNESS_M)
    for asset in scene.assets.values():
        radius = terrain.world.platforms[asset.kind].radius_m
        if asset.kind != "uav" and gap(wall, asset.x, asset.y) < radius:
            raise ValueError(f"{asset.id} stands where the obstruction would lie")
    scene.obstructions = (*scene.obstructions, wall)
    return True


def notice(terrain: Terrain, scene: Scene, asset: AssetState) -> bool:
    """Let a ground asset that cannot go on see what lies near it; return whether it is news."""
    reach = terrain.world.platforms[asset.kind].radius_m + SEEN_M
    news = tuple(
        wall
        for wall in scene.obstructions
        if wall not in asset.obstructions and gap(wall, asset.x, asset.y) <= reach
    )
    asset.obstructions = (*asset.obstructions, *news)
    return bool(news)
