"""The simulated fleet in this process, and outlooks from a single picture.

The later steps of an order are planned against a `ForeseenFleet`, which is the result of the
rehearsal of the earlier steps.
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
"""A function that returns the token for a command; None if it gets no token."""

Verify = Callable[[str | None, DeviceCommand], str]
"""A function that returns why a vehicle refuses a command with its token; '' if it accepts it."""


@dataclass(eq=False)
class SimulatedFleet:
    """The fleet of a simulated `checkpoint`; only evaluations read the truth from `checkpoint`."""

    checkpoint: Checkpoint
    _authorize: Authorize | None = field(default=None, init=False)
    _tokens: dict[str, str | None] = field(default_factory=dict[str, str | None], init=False)
    """The latest token of each command, by its id, until the device verifies it."""

    @classmethod
    def start(cls, world: World, seed: int = 0, scenario: Scenario | None = None) -> Self:
        """Return the assets of `world` at their posts, in `scenario` if one is given.

        Raises ValueError if there is no place for an asset.
        """
        return cls(Checkpoint(world, seed, scenario))

    def use(self, authorize: Authorize, verify: Verify) -> None:
        """Send commands with tokens from now on; the devices verify them."""
        self._authorize = authorize
        tokens = self._tokens
        self.checkpoint.admit = lambda command: verify(
            tokens.pop(command.command_id, None), command
        )

    @property
    def world(self) -> World:
        """The simulated world."""
        return self.checkpoint.world

    @property
    def seed(self) -> int:
        """The seed of the checkpoint's random numbers."""
        return self.checkpoint.seed

    @property
    def tick(self) -> int:
        """The number of steps since the session began."""
        return self.checkpoint.tick

    @property
    def time_s(self) -> float:
        """The simulated seconds since the session began."""
        return self.checkpoint.time_s

    def picture(self) -> Picture:
        """Return the picture from the last reports; it changes every `world.telemetry_period_s`."""
        return self.checkpoint.picture()

    def send(self, command: DeviceCommand) -> None:
        """Send `command` over the link; its device receives and answers it at the next step."""
        if self._authorize is not None:
            self._tokens[command.command_id] = self._authorize(command)
        self.checkpoint.send(command)

    def step(self) -> Received:
        """Advance by `world.dt_s`; return replies, incidents, and notices of skipped incidents."""
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
        """Show `assets`, and no others, as under manual control from this station, at once."""
        self.checkpoint.mark_manual(assets)

    def still(self, camera: str, track: str) -> Callable[[], bytes] | None:
        """Return a function that draws `track` as `camera` sees it now; None without an image."""
        return self.checkpoint.still(camera, track)

    def forecast(self) -> Forecast:
        """Return a simulation from the picture and the world only."""
        return self.checkpoint.forecast()

    def inject(self, incident: Incident) -> None:
        """Apply `incident` now; it appears in the picture once telemetry reports it.

        Raises ValueError for an unknown name; the message lists the known names.
        """
        self.checkpoint.inject(incident)

    def close(self) -> None:
        """Do nothing, because there is no device to release."""


class ShownPicture:
    """An outlook from a single picture, such as another station's; it commands no asset."""

    def __init__(self, world: World) -> None:
        self._terrain = Terrain.of(world)
        self._picture: Picture | None = None

    @property
    def world(self) -> World:
        """The world of the picture."""
        return self._terrain.world

    def show(self, picture: Picture | None) -> None:
        """Use `picture` from now on; None means that there is none yet."""
        self._picture = picture

    def picture(self) -> Picture:
        """Return the picture; raises ValueError if there is none yet."""
        if self._picture is None:
            raise ValueError("there is no picture yet")
        return self._picture

    def forecast(self) -> Checkpoint:
        """Return a simulation from the picture and the world only."""
        return Checkpoint.ahead_of(self._terrain, self.picture())


class ForeseenFleet(ShownPicture):
    """The fleet in `picture`, the last picture of a rehearsal; it commands no device."""

    def __init__(self, world: World, picture: Picture) -> None:
        super().__init__(world)
        self.show(picture)

    @property
    def tick(self) -> int:
        """The step of the fleet's clock for which the picture was forecast."""
        return self.picture().tick

    @property
    def time_s(self) -> float:
        """The time of the picture on the fleet's clock, in seconds."""
        return self.picture().time_s

    def send(self, command: DeviceCommand) -> None:
        """Raise RuntimeError, because there is no device."""
        raise RuntimeError(f"{command.command_id} is for a fleet that is only a forecast")

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Do nothing; the picture is fixed, including the assets marked as under manual control."""

    def step(self) -> Received:
        """Return nothing, because the picture does not change."""
        return Received()

    def close(self) -> None:
        """Do nothing, because there is no device to release."""
