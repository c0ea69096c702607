"""The `run` that success conditions see: what truly happened, as plain values (design, formats).

Times are simulated seconds since the command, -1.0 where something never happened; distances are
metres. Names that are not there ("between frames", "no post", "no frame") are ''.
"""

from typing import Any

from pydantic import Field

from pa_console.schema.base import StrictModel
from pa_console.schema.mission import MissionStatus
from pa_console.schema.plan import Verb
from pa_console.schema.telemetry import AssetStatus, Identity, Intent, Task, TrackStatus
from pa_console.schema.world import AssetKind

NEVER = -1.0


class ActionFact(StrictModel):
    """A command that was sent to a device, those of a stop or a halt included."""

    agent: str
    kind: AssetKind | None = Field(description="None, as CEL sees it '', for an unknown agent")
    verb: Verb
    frame: str
    sent_s: float
    done: bool = Field(description="the device reported it done")
    rejected: bool = Field(description="the device refused it")


class AssetFact(StrictModel):
    """One asset as it truly was."""

    kind: AssetKind
    at: str
    post: str
    task: Task
    status: AssetStatus
    available: bool
    battery_pct: float
    x: float
    y: float


class GateFact(StrictModel):
    """Who truly covered a gate."""

    covered: bool
    by: tuple[str, ...]


class CoverageFact(StrictModel):
    """How a gate was covered from the command on."""

    at_start: bool
    at_end: bool
    longest_gap_s: float
    uncovered_s: float


class TrackFact(StrictModel):
    """A vehicle or person and what truly was done about it.

    One that was observed, identified or warned before the command has 0.0 there. `status` is that
    of when it was there last, `present` whether it still is.
    """

    id: str = Field(description="the track id that the station first gave it, else its own")
    gate: str
    kind: str
    identity: Identity = Field(description="the true one")
    intent: Intent = Field(description="the true one")
    noncombatants: bool
    status: TrackStatus
    present: bool
    observed_s: float = Field(description="a working UAV had it in sensor range")
    identified_s: float
    warned_s: float
    blocked_s: float = Field(description="a UGV under a block order stood at its gate")
    contact_s: float = Field(description="a ground asset sent out had it in sensor range")
    closest_ground_m: float = Field(description="of ground assets sent out; -1.0 none")
    by_order_observed: bool = Field(description="a UAV ordered to observe its gate had it in range")
    by_order_identified: bool = Field(description="identified after an identify order to its gate")


class Snapshot(StrictModel):
    """The true state at the command or at the end."""

    assets: dict[str, AssetFact]
    gates: dict[str, GateFact]
    tracks: tuple[TrackFact, ...]


class RunFacts(StrictModel):
    """A finished run by its true state."""

    command: str
    status: MissionStatus
    refused: bool = Field(description="nothing was ordered but hold and report")
    duration_s: float
    grace_s: float
    standoff_m: float
    gates: tuple[str, ...]
    base: str
    actions: tuple[ActionFact, ...]
    reports: tuple[str, ...] = Field(description="agents ordered to report that answered")
    start: Snapshot
    final: Snapshot
    coverage: dict[str, CoverageFact]
    moved: tuple[str, ...] = Field(description="assets that an order made leave their place")
    visited: dict[str, tuple[str, ...]] = Field(description="frames stood at since, in order")
    tracks: tuple[TrackFact, ...]
    broken: tuple[str, ...] = Field(default=(), description="ids of broken rules, sorted")

    def document(self) -> dict[str, Any]:
        """Return the facts as plain values, as conditions see them under the name `run`."""
        document = self.model_dump(mode="json")
        for action in document["actions"]:
            action["kind"] = action["kind"] or ""
        return document
