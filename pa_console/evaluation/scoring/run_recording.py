"""A run as the scorer keeps it: the true state at every sample, and the orders that were given.

Times are simulated seconds since the mission's command was given; positions are metres.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from pydantic import Field

from pa_console.schema.base import NonNegative, Point, StrictModel
from pa_console.schema.command import Verb
from pa_console.schema.telemetry import AssetStatus, Task
from pa_console.schema.world import AssetKind, World
from pa_console.sim.truth import TrueContact

STAYING: frozenset[Verb] = frozenset(("hold", "report"))
"""Orders that send no asset anywhere."""


class Breach(StrictModel):
    """An enforced rule that the true state shows to be broken."""

    rule_id: str
    what: str
    at_s: NonNegative = Field(description="simulated seconds after the command")


class AssetTruth(NamedTuple):
    """One asset as it truly is at one moment; `at` and `post` are '' for none."""

    id: str
    kind: AssetKind
    position: Point
    at: str
    post: str
    task: Task
    status: AssetStatus
    available: bool
    battery_pct: float
    command_id: str


class Sample(NamedTuple):
    """The true state at `time_s`; `cover` names who covers each gate."""

    time_s: float
    assets: dict[str, AssetTruth]
    contacts: dict[str, TrueContact]
    cover: dict[str, tuple[str, ...]]


@dataclass(slots=True)
class IssuedCommand:
    """A command that went out to a device; `frame` is where it leads, '' when nowhere."""

    command_id: str
    agent: str
    verb: Verb
    frame: str
    sent_s: float
    done: bool = False
    rejected: bool = False


@dataclass(slots=True)
class RunRecording:
    """Samples in order of time, the first at the command itself, and the orders as sent."""

    world: World
    command: str
    samples: list[Sample] = field(default_factory=list[Sample])
    orders: list[IssuedCommand] = field(default_factory=list[IssuedCommand])

    @property
    def start(self) -> Sample:
        """The truth at the moment of the command."""
        return self.samples[0]

    @property
    def final(self) -> Sample:
        """The truth at the end."""
        return self.samples[-1]

    def at(self, time_s: float) -> Sample:
        """Return the latest sample that is not after `time_s`, the first one before all."""
        return next((s for s in reversed(self.samples) if s.time_s <= time_s + 1e-6), self.start)

    def steps(self) -> Iterator[tuple[Sample, Sample]]:
        """Yield each sample with the one before it."""
        yield from zip(self.samples, self.samples[1:], strict=False)

    def goal(self, order: IssuedCommand) -> str:
        """Return the frame to which the order sends its agent, '' when it stays."""
        return self.world.base if order.verb == "return_to_base" else order.frame

    def latest(self, agent: str, time_s: float) -> IssuedCommand | None:
        """Return the order that binds `agent` at `time_s`; a report or a refused order does not."""
        return next(
            (
                order
                for order in reversed(self.orders)
                if order.agent == agent
                and order.sent_s <= time_s + 1e-6
                and order.verb != "report"
                and not order.rejected
            ),
            None,
        )

    def sent_out(self) -> Iterator[tuple[IssuedCommand, AssetTruth, AssetTruth]]:
        """Yield the assets that an order moves: the order, before, after a step."""
        moving = {o.command_id: o for o in self.orders if o.verb not in STAYING}
        for was, now in self.steps():
            for name, asset in now.assets.items():
                before = was.assets[name]
                order = moving.get(asset.command_id) or moving.get(before.command_id)
                if order is not None and before.position != asset.position:
                    yield order, before, asset
