"""The dynamic state of a simulated checkpoint: everything that a fork copies and a hash covers."""

import copy
import hashlib
import math
import random
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from operator import attrgetter

from pa_console.schema.base import Point
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.telemetry import AssetTelemetry, Task
from pa_console.schema.world import AssetKind, Wall
from pa_console.sim.state.link_state import UNDISTURBED, Drift, LinkState, RadioState, StationState
from pa_console.sim.state.sensing_state import ContactState, SensingState


@dataclass(slots=True)
class ScriptState:
    """Progress of a scenario whose random events are drawn from `seed`.

    `due_s` says when a scripted event happens, known once its condition has held; `happened` and
    `skipped` hold the events that are over. `drawn` counts the random events of each process,
    the next of which is due at `next_s`. Events and processes are named by their index.
    """

    seed: int = 0
    due_s: dict[int, float] = field(default_factory=dict[int, float])
    happened: tuple[int, ...] = ()
    skipped: tuple[int, ...] = ()
    drawn: tuple[int, ...] = ()
    next_s: tuple[float, ...] = ()

    def copy(self) -> "ScriptState":
        """Return an independent copy."""
        return ScriptState(
            seed=self.seed,
            due_s=dict(self.due_s),
            happened=self.happened,
            skipped=self.skipped,
            drawn=self.drawn,
            next_s=self.next_s,
        )


@dataclass(slots=True)
class AssetState:
    """One asset as it truly is; fields hold immutable values, so a shallow copy is a copy.

    `station` is where it stands or is going to stand, `route` the waypoints still ahead, `origin`
    where the present leg began; `obstructions` are those
    that it has run into. `nearest_m` and `nearest_tick` are the least way left so far and
    when it was reached; `stalls` counts how often the leg got stuck. `heard_tick` is when the
    station last got through to it; while it is `cut_off` it `owes` the replies on how its command
    ended. `place` is the frame it was at when it was at `placed_at`; its battery is as of
    `settled_tick`. `said` is its last report, None once more than its battery may have changed
    since; it follows from the rest, so the hash leaves it out.
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
    radio: RadioState = UNDISTURBED
    task: Task = "idle"
    speed: float = 0.0
    speed_factor: float = 1.0
    failed: bool = False
    heard_tick: int = 0
    cut_off: bool = False
    owes: tuple[CommandReply, ...] = ()
    drift: Drift | None = None
    spoofed: str | None = None
    settled_tick: int = 0
    place: str | None = None
    placed_at: Point | None = None
    obstructions: tuple[Wall, ...] = ()
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
    said: AssetTelemetry | None = field(default=None, repr=False, compare=False)

    @property
    def position(self) -> Point:
        """The position, metres."""
        return (self.x, self.y)

    @property
    def down(self) -> bool:
        """True if it cannot act: failed, or its battery is empty."""
        return self.failed or self.battery <= 0.0

    def stop(self, task: Task) -> None:
        """Stand where it is from now on, with `task`."""
        self.route, self.speed, self.task = (), 0.0, task
        self.station, self.held_by = self.position, ""


_index = attrgetter("index")


@dataclass(slots=True)
class Scene:
    """The whole dynamic state: the truth, and in `station` what of it has reached the station.

    `covered_tick` is when a gate was last truly covered. `active` names the assets that every
    step has to look after; those that stand idle are left alone. In an `ideal` scene, that of a
    forecast, messages are never lost, and assets report only what has changed: `touched` names
    those that have been active since the last picture.
    """

    rng: random.Random
    tick: int = 0
    assets: dict[str, AssetState] = field(default_factory=dict[str, AssetState])
    link: LinkState = field(default_factory=LinkState)
    sensing: SensingState = field(default_factory=SensingState)
    script: ScriptState = field(default_factory=ScriptState)
    obstructions: tuple[Wall, ...] = ()
    station: StationState = field(default_factory=StationState)
    covered_tick: dict[str, int] = field(default_factory=dict[str, int])
    active: set[str] = field(default_factory=set[str])
    ideal: bool = False
    touched: set[str] = field(default_factory=set[str])

    def busy(self) -> list[AssetState]:
        """Return the assets that every step has to look after, in the team's order."""
        return self.in_order(self.active)

    def in_order(self, names: Iterable[str]) -> list[AssetState]:
        """Return the assets of these names in the team's order."""
        return sorted([self.assets[name] for name in names], key=_index)

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
            link=self.link.copy(),
            sensing=self.sensing.copy(),
            script=self.script.copy(),
            obstructions=self.obstructions,
            station=self.station.copy(),
            covered_tick=dict(self.covered_tick),
            active=set(self.active),
            ideal=self.ideal,
            touched=set(self.touched),
        )

    def digest(self) -> str:
        """Return the SHA-256 over every field, floats to their last bit and sets in order."""
        unordered = self.sensing.broken, self.sensing.cleared
        sensing = replace(self.sensing, broken=frozenset(), cleared=frozenset())
        parts = (
            self.rng.getstate(), self.tick, self.assets, self.link, sensing, self.script,
            self.obstructions, self.station, self.covered_tick, sorted(self.active), self.ideal,
            sorted(self.touched), *map(sorted, unordered),
        )  # fmt: skip
        return hashlib.sha256(repr(parts).encode()).hexdigest()
