"""The dynamic state of a simulated checkpoint: everything that a fork copies and a hash covers."""

import copy
import hashlib
import math
import random
from dataclasses import dataclass, field

from pa_console.schema.base import Point
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.telemetry import (
    AssetTelemetry,
    CommsStatus,
    GateCover,
    Task,
)
from pa_console.schema.world import AssetKind, Wall
from pa_console.sim.script_state import ScriptState
from pa_console.sim.sensing_state import ContactState, SensingState


@dataclass(slots=True)
class AssetState:
    """One asset as it truly is; fields hold immutable values, so a shallow copy is a copy.

    `station` is where it stands or is going to stand, `route` the waypoints still ahead, `origin`
    where the present leg began. `nearest_m` and `nearest_tick` are the least way left so far and
    when it was reached; `stalls` counts how often the leg got stuck.
    """

    id: str
    kind: AssetKind
    index: int
    x: float
    y: float
    heading: float
    battery: float
    post: str | None
    station: Point
    task: Task = "idle"
    speed: float = 0.0
    failed: bool = False
    comms: CommsStatus = "ok"
    command: DeviceCommand | None = None
    origin: Point = (0.0, 0.0)
    route: tuple[Point, ...] = ()
    nearest_m: float = math.inf
    nearest_tick: int = 0
    stalls: int = 0
    held_by: str = ""
    dwell: int = 0
    announced: bool = False
    progress_tick: int = 0
    answered: tuple[CommandReply, ...] = ()

    @property
    def position(self) -> Point:
        """Where it is, metres."""
        return (self.x, self.y)

    @property
    def down(self) -> bool:
        """Whether it cannot do anything: failed, or its battery is empty."""
        return self.failed or self.battery <= 0.0

    @property
    def available(self) -> bool:
        """Whether it can be counted on: not down and its link not lost."""
        return not self.down and self.comms != "lost"

    def stop(self, task: Task) -> None:
        """Stand where it is from now on, with `task`."""
        self.route, self.speed, self.task = (), 0.0, task
        self.station, self.held_by = self.position, ""


@dataclass(slots=True)
class LinkState:
    """Messages on the in-process link: (tick due, order of sending, message)."""

    sent: int = 0
    commands: tuple[tuple[int, int, DeviceCommand], ...] = ()
    replies: tuple[tuple[int, int, CommandReply], ...] = ()


@dataclass(slots=True)
class Scene:
    """The whole dynamic state; `reports` and `covers` are telemetry as last received."""

    rng: random.Random
    tick: int = 0
    assets: dict[str, AssetState] = field(default_factory=dict[str, AssetState])
    link: LinkState = field(default_factory=LinkState)
    sensing: SensingState = field(default_factory=SensingState)
    script: ScriptState = field(default_factory=ScriptState)
    obstructions: tuple[Wall, ...] = ()
    reports: dict[str, AssetTelemetry] = field(default_factory=dict[str, AssetTelemetry])
    covers: dict[str, GateCover] = field(default_factory=dict[str, GateCover])
    covered_tick: dict[str, int] = field(default_factory=dict[str, int])

    @property
    def contacts(self) -> dict[str, ContactState]:
        """Vehicles and persons that are not ours, as they truly are."""
        return self.sensing.contacts

    def copy(self) -> "Scene":
        """Return an independent copy; immutable messages and reports are shared."""
        rng = random.Random()
        rng.setstate(self.rng.getstate())
        return Scene(
            rng=rng,
            tick=self.tick,
            assets={name: copy.copy(asset) for name, asset in self.assets.items()},
            link=copy.copy(self.link),
            sensing=self.sensing.copy(),
            script=self.script.copy(),
            obstructions=self.obstructions,
            reports=dict(self.reports),
            covers=dict(self.covers),
            covered_tick=dict(self.covered_tick),
        )

    def digest(self) -> str:
        """Return the SHA-256 over every field, floats to their last bit."""
        parts = (
            self.rng.getstate(), self.tick, self.assets, self.link,
            self.sensing, self.script, self.obstructions, self.reports, self.covers,
            self.covered_tick,
        )  # fmt: skip
        return hashlib.sha256(repr(parts).encode()).hexdigest()
