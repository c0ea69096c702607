"""The outlook from a picture alone: for whoever watches a fleet and commands none of it."""

from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.terrain import Terrain


class ShownPicture:
    """A picture reported by another station, and the forecast from it; it commands no asset."""

    def __init__(self, world: World) -> None:
        self._terrain = Terrain(world)
        self._picture: Picture | None = None

    @property
    def world(self) -> World:
        """The world of the fleet."""
        return self._terrain.world

    def show(self, picture: Picture | None) -> None:
        """Go by `picture` from now on; None where nothing has been told yet."""
        self._picture = picture

    def picture(self) -> Picture:
        """Return the picture; raises ValueError before there is one."""
        if self._picture is None:
            raise ValueError("no picture has been told yet")
        return self._picture

    def forecast(self) -> Checkpoint:
        """Return a simulation of what the picture shows, built from it and the world alone."""
        return Checkpoint.ahead_of(self._terrain, self.picture())
