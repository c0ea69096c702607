"""The fleet protocol: assets with their sensors, simulated or real.

A custom fleet implements `Fleet`. The packages above this one do not depend on an implementation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.events.event import IncidentHappened, Noticed
from pa_console.schema.incident import Incident
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import Background, World


@dataclass(frozen=True)
class PlanCountersignature:
    """A second person's valid signature, made at another station, for the plan that waits here."""

    request_id: str
    person: str
    signature: str


@dataclass(frozen=True)
class Received:
    """The results of one step, in order of arrival."""

    replies: tuple[CommandReply, ...] = ()
    told: tuple[IncidentHappened | Noticed, ...] = ()
    """Further events of the fleet, for the session log."""
    countersigned: tuple[PlanCountersignature, ...] = ()
    stop_asked: str = ""
    """The person at another station who asks for a stop; '' if nobody does."""


class Forecast(Protocol):
    """A simulation that starts from a fleet's picture; no command in it reaches a device."""

    @property
    def world(self) -> World:
        """The world of the fleet."""
        ...

    @property
    def time_s(self) -> float:
        """The simulated time, in seconds on the fleet's clock."""
        ...

    def picture(self) -> Picture:
        """Return the picture according to the last simulated reports."""
        ...

    def send(self, command: DeviceCommand) -> None:
        """Send `command` to its simulated device."""
        ...

    def step(self) -> Sequence[CommandReply]:
        """Simulate the next `world.dt_s` seconds; return the replies that arrive in this time."""
        ...


class Outlook(Protocol):
    """The current picture and forecasts from it, against which plans are checked and rehearsed."""

    @property
    def world(self) -> World:
        """The world of the fleet."""
        ...

    def picture(self) -> Picture:
        """Return the picture from the last reports; it changes every `world.telemetry_period_s`."""
        ...

    def forecast(self) -> Forecast:
        """Return a forecast, which uses only the picture and the world."""
        ...


class Fleet(Outlook, Protocol):
    """The assets and sensors of one station, which calls `step` at the rate of its own clock.

    `step` returns the replies to a command, with its id: `acknowledged` or `refused`, then `done`
    or `failed`. A device accepts a command id once and then repeats its last answer, so that a
    command may be sent again. A command without an answer times out at the station.
    """

    @property
    def tick(self) -> int:
        """The number of steps since the session began."""
        ...

    @property
    def time_s(self) -> float:
        """The time on the fleet's clock, in seconds: `tick` steps of `world.dt_s`."""
        ...

    def send(self, command: DeviceCommand) -> None:
        """Send `command` over the link to its device; returns at once and never raises."""
        ...

    def step(self) -> Received:
        """Advance the clock by `world.dt_s`; return everything received since the last step."""
        ...

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Show `assets`, and no others, as under manual control from this station, at once.

        In the picture they are `manual` and not `available`, like assets that report manual control
        themselves.
        """
        ...

    def close(self) -> None:
        """Release the devices at the end of the session."""
        ...


@runtime_checkable
class Filmed(Protocol):
    """A fleet whose cameras provide images, which are shown to people only."""

    def still(self, camera: str, track: str) -> Callable[[], bytes] | None:
        """Return a function that makes a PNG of `track` as `camera` sees it at this moment.

        The function may be called in any thread. None means that there is no image.
        """
        ...


@runtime_checkable
class RelaysImages(Protocol):
    """A fleet or a link on which cameras publish images, which are shown to people only."""

    def image_on(self, topic: str) -> bytes:
        """Return the next image on `topic`; waits in the caller's thread.

        Raises SnapshotError if no image arrives in time, or if the image is not valid.
        """
        ...


@runtime_checkable
class MapsGround(Protocol):
    """A fleet whose robots map the ground; the map is only drawn and does not restrict routes."""

    @property
    def background(self) -> Background | None:
        """The newest map; None before the first map."""
        ...


@runtime_checkable
class Simulated(Fleet, Protocol):
    """A simulated fleet, in which the scenario makes incidents happen."""

    @property
    def seed(self) -> int:
        """The seed of the random numbers."""
        ...

    def inject(self, incident: Incident) -> None:
        """Make `incident` happen now.

        Raises ValueError for an unknown name; the message lists the known names.
        """
        ...
