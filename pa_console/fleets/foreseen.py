"""A fleet as a forecast leaves it: what a later step of an order is planned against."""

from pa_console.fleets.fleet import Received
from pa_console.fleets.simulated import ShownPicture
from pa_console.schema.command import DeviceCommand
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World


class ForeseenFleet(ShownPicture):
    """The fleet of `world` in a picture that a rehearsal has ended with; it commands no device."""

    def __init__(self, world: World, picture: Picture) -> None:
        super().__init__(world)
        self.show(picture)

    @property
    def tick(self) -> int:
        """The step of the fleet's clock at which the picture is foreseen."""
        return self.picture().tick

    @property
    def time_s(self) -> float:
        """The time of the picture on the fleet's clock, seconds."""
        return self.picture().time_s

    def send(self, command: DeviceCommand) -> None:
        """Refuse: raises RuntimeError, for there is no device."""
        raise RuntimeError(f"{command.command_id} is for a fleet that is only foreseen")

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Do nothing: the picture shows who was under manual control when it was foreseen."""

    def step(self) -> Received:
        """Return nothing: the picture stands still."""
        return Received()

    def close(self) -> None:
        """Do nothing: there is no device to let go of."""
