"""The fleet of a simulated checkpoint in this process, and the outlook from a picture alone.

A forecast leaves a fleet too: a later step of an order is planned against it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from pa_console.fleets.fleet import Forecast, Received
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events.event import IncidentHappened, Noticed
from pa_console.schema.incident import Incident, Scenario
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.terrain import Terrain

Authorize = Callable[[DeviceCommand], str | None]
"""Returns the token that a command goes out with, None for none."""

Verify = Callable[[str | None, DeviceCommand], str]
"""Returns, at the vehicle, why a command with that token is refused; '' when it is taken."""


@dataclass(eq=False)
class SimulatedFleet:
    """Drives `checkpoint`; an evaluation asks that for the truth, and nothing else does."""

    checkpoint: Checkpoint
    _authorize: Authorize | None = field(default=None, init=False)
    _tokens: dict[str, str | None] = field(default_factory=dict[str, str | None], init=False)
    """The latest token of each command, by its id, until its device asks for it."""

    @classmethod
    def start(cls, world: World, seed: int = 0, scenario: Scenario | None = None) -> Self:
        """Return the assets of `world` on their watch, in `scenario` if one is given.

        Raises ValueError if an asset has no place.
        """
        return cls(Checkpoint(world, seed, scenario))

    def use(self, authorize: Authorize, verify: Verify) -> None:
        """Let commands go out with tokens from now on, which the devices verify."""
        self._authorize = authorize
        tokens = self._tokens
        self.checkpoint.admit = lambda command: verify(
            tokens.pop(command.command_id, None), command
        )

    @property
    def world(self) -> World:
        """The world that is simulated."""
        return self.checkpoint.world

    @property
    def seed(self) -> int:
        """The seed of the checkpoint's random draws."""
        return self.checkpoint.seed

    @property
    def tick(self) -> int:
        """Steps taken since the session began."""
        return self.checkpoint.tick

    @property
    def time_s(self) -> float:
        """Simulated seconds since the session began."""
        return self.checkpoint.time_s

    def picture(self) -> Picture:
        """Return telemetry as last reported, every `world.telemetry_period_s`."""
        return self.checkpoint.picture()

    def send(self, command: DeviceCommand) -> None:
        """Put `command` on the link; its device gets it at the next step and answers."""
        if self._authorize is not None:
            self._tokens[command.command_id] = self._authorize(command)
        self.checkpoint.send(command)

    def step(self) -> Received:
        """Advance by one `world.dt_s`; emit the scenario's incidents and the failed ones."""
        replies = tuple(self.checkpoint.step())
        happened = self.checkpoint.take_incidents()
        skipped = self.checkpoint.take_skipped()
        return Received(
            replies,
            (
                *(IncidentHappened(incident=incident, source="scenario") for incident in happened),
                *(Noticed(level="warning", subject="scenario", text=text) for text in skipped),
            ),
        )

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Show `assets`, and no others, as taken under manual control at this station; at once."""
        self.checkpoint.mark_manual(assets)

    def still(self, camera: str, track: str) -> Callable[[], bytes] | None:
        """Return what draws the present picture of `track` by `camera`, None for none."""
        return self.checkpoint.still(camera, track)

    def forecast(self) -> Forecast:
        """Return a simulation of what the picture shows, built from it and the world alone."""
        return self.checkpoint.forecast()

    def inject(self, incident: Incident) -> None:
        """Apply `incident` now; it appears in the picture once telemetry reports it.

        Raises ValueError with the valid names for an unknown one.
        """
        self.checkpoint.inject(incident)

    def close(self) -> None:
        """Do nothing: there is no device to let go of."""


class ShownPicture:
    """A picture reported by another station, and the forecast from it; it commands no asset."""

    def __init__(self, world: World) -> None:
        self._terrain = Terrain.of(world)
        self._picture: Picture | None = None

    @property
    def world(self) -> World:
        """The world of the fleet."""
        return self._terrain.world

    def show(self, picture: Picture | None) -> None:
        """Use `picture` from now on; None before the first one."""
        self._picture = picture

    def picture(self) -> Picture:
        """Return the picture; raises ValueError before there is one."""
        if self._picture is None:
            raise ValueError("no picture has been told yet")
        return self._picture

    def forecast(self) -> Checkpoint:
        """Return a simulation of what the picture shows, built from it and the world alone."""
        return Checkpoint.ahead_of(self._terrain, self.picture())


class ForeseenFleet(ShownPicture):
    """The fleet of `world` in the picture that a rehearsal ended with; it commands no device."""

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
