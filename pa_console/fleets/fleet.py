"""The fleet protocol: assets with their sensors, simulated or real.

A fleet of your own implements `Fleet`; nothing above this package depends on an implementation.
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
    """A second person's valid signature, given elsewhere, for a plan that waits here."""

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
    """The person at another station who asks for a stop; '' for none."""


class Forecast(Protocol):
    """A simulation of what a fleet's picture leads to; no command in it reaches a device."""

    @property
    def world(self) -> World:
        """The world of the fleet."""
        ...

    @property
    def time_s(self) -> float:
        """Seconds on the fleet's clock, as far as the forecast has got."""
        ...

    def picture(self) -> Picture:
        """Return telemetry as it would have been reported last."""
        ...

    def send(self, command: DeviceCommand) -> None:
        """Let a device have `command` in the forecast."""
        ...

    def step(self) -> Sequence[CommandReply]:
        """Go on by `world.dt_s`; return the replies that would arrive meanwhile."""
        ...


class Outlook(Protocol):
    """A present picture, and a forecast from it: what plans are checked and rehearsed against."""

    @property
    def world(self) -> World:
        """The world of the fleet."""
        ...

    def picture(self) -> Picture:
        """Return telemetry as last reported, every `world.telemetry_period_s`."""
        ...

    def forecast(self) -> Forecast:
        """Return a forecast from the picture and the world alone."""
        ...


class Fleet(Outlook, Protocol):
    """The assets and sensors that one station has; it steps them at its own clock.

    A command is answered through `step` by replies with its id: `acknowledged` or `refused`, then
    `done` or `failed`. A device takes a command id once and repeats its last answer, so a command
    that is sent again is harmless; one that is never answered times out at the station.
    """

    @property
    def tick(self) -> int:
        """Steps taken since the session began."""
        ...

    @property
    def time_s(self) -> float:
        """Seconds on the fleet's clock: `tick` steps of `world.dt_s`."""
        ...

    def send(self, command: DeviceCommand) -> None:
        """Put `command` on the link to its device; returns at once and raises nothing."""
        ...

    def step(self) -> Received:
        """Move the clock on by `world.dt_s`; return what came in since the last step."""
        ...

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Show `assets`, and no others, as taken under manual control at this station; at once.

        In the picture they are `manual` and not `available`, as assets are that report it.
        """
        ...

    def close(self) -> None:
        """Let go of the devices: the session is over."""
        ...


@runtime_checkable
class Filmed(Protocol):
    """A fleet whose cameras give pictures; they are for people alone."""

    def still(self, camera: str, track: str) -> Callable[[], bytes] | None:
        """Return what makes a PNG, in any thread, of what `camera` sees of `track` at this moment.

        None stands for no picture.
        """
        ...


@runtime_checkable
class MapsGround(Protocol):
    """A fleet whose robots make a map of the ground; it is drawn, and no barrier to any route."""

    @property
    def background(self) -> Background | None:
        """The newest map, None before there is one."""
        ...


@runtime_checkable
class Simulated(Fleet, Protocol):
    """A fleet in which incidents can be made to happen."""

    @property
    def seed(self) -> int:
        """The seed of its random draws."""
        ...

    def inject(self, incident: Incident) -> None:
        """Make `incident` happen now; raises ValueError naming what exists for an unknown name."""
        ...
