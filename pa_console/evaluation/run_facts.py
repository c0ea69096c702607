"""A run as the scorer keeps it, and the `run` that success conditions see: what truly happened.

A recording has the true state at every sample and the orders that were given; the facts are plain
values drawn from it (design, formats). Times are simulated seconds since the mission's command was
given, -1.0 where something never happened; positions and distances are metres. Names that are not
there ("between frames", "no post", "no frame") are ''.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

from pydantic import Field

from pa_console.schema.base import NonNegative, StrictModel
from pa_console.schema.command import Verb
from pa_console.schema.mission import MissionStatus
from pa_console.schema.telemetry import (
    AssetStatus,
    AssetTelemetry,
    Identity,
    Intent,
    Task,
    TrackStatus,
)
from pa_console.schema.world import AssetKind, World
from pa_console.sim.truth import TrueContact

STAYING: frozenset[Verb] = frozenset(("hold", "report"))
"""Orders that send no asset anywhere."""

ENCOUNTERS = frozenset(("identify", "warn", "block"))
"""Orders that lead an asset to a contact."""

NEVER = -1.0
MOVED_M = 2.0
"""An asset that an order has displaced this far has moved."""


class RuleBreach(StrictModel):
    """An enforced rule that the true state shows to be broken."""

    rule_id: str
    what: str
    at_s: NonNegative = Field(description="simulated seconds after the command")


class Sample(NamedTuple):
    """The true state at `time_s`; `cover` names who covers each gate."""

    time_s: float
    assets: dict[str, AssetTelemetry]
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

    def sent_out(self) -> Iterator[tuple[IssuedCommand, AssetTelemetry, AssetTelemetry]]:
        """Yield the assets that an order moves: the order, before, after a step."""
        moving = {o.command_id: o for o in self.orders if o.verb not in STAYING}
        for was, now in self.steps():
            for name, asset in now.assets.items():
                before = was.assets[name]
                order = moving.get(asset.command_id or "") or moving.get(before.command_id or "")
                if order is not None and before.position != asset.position:
                    yield order, before, asset


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
    """The true cover of a gate."""

    covered: bool
    by: tuple[str, ...]


class CoverageFact(StrictModel):
    """The cover of a gate from the command on."""

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


@dataclass(slots=True)
class _Story:
    """The events of one contact so far; `last` is its last known state.

    `times` has the first time, in seconds, of each event of a TrackFact that has happened.
    """

    last: TrueContact
    track: str = ""
    times: dict[str, float] = field(default_factory=dict[str, float])
    closest_m: float = NEVER
    by_order_observed: bool = False
    by_order_identified: bool = False


def track_facts(recording: RunRecording, moved: Mapping[str, float]) -> tuple[TrackFact, ...]:
    """Return every contact that was there at some time of `recording`, in the order of appearance.

    `moved` tells who was moved by an order, and when that was sent, seconds.
    """
    stories: dict[str, _Story] = {}
    ordered = [
        name for name in recording.start.assets if any(o.agent == name for o in recording.orders)
    ]
    for sample in recording.samples:
        if not sample.contacts:
            continue
        orders = {name: recording.latest(name, sample.time_s) for name in ordered}
        out = {name for name, since_s in moved.items() if since_s <= sample.time_s}
        for name, contact in sample.contacts.items():
            story = stories.setdefault(name, _Story(contact))
            story.last, story.track = contact, story.track or contact.track
            _note_state(recording, sample.time_s, story)
            for agent, order in orders.items():
                if order is not None:
                    _meet(sample, story, order)
                    if order.verb in ENCOUNTERS or (agent in out and order.verb != "hold"):
                        _approach(recording, sample, story, agent)
    return tuple(
        TrackFact(
            id=story.track or name,
            gate=story.last.gate,
            kind=story.last.kind,
            identity=story.last.identity,
            intent=story.last.intent,
            noncombatants=story.last.noncombatants,
            status=story.last.status,
            present=name in recording.final.contacts,
            observed_s=story.times.get("observed", NEVER),
            identified_s=story.times.get("identified", NEVER),
            warned_s=story.times.get("warned", NEVER),
            blocked_s=story.times.get("blocked", NEVER),
            contact_s=story.times.get("contact", NEVER),
            closest_ground_m=round(story.closest_m, 3),
            by_order_observed=story.by_order_observed,
            by_order_identified=story.by_order_identified,
        )
        for name, story in stories.items()
    )


def _note_state(recording: RunRecording, time_s: float, story: _Story) -> None:
    """Note what one sample shows of the contact itself."""
    contact = story.last
    if contact.watched_by or contact.observed:
        story.times.setdefault("observed", time_s)
    if contact.identified and "identified" not in story.times:
        story.times["identified"] = time_s
        story.by_order_identified = any(
            order.verb == "identify" and order.frame == contact.gate and order.sent_s <= time_s
            for order in recording.orders
        )
    if contact.warned:
        story.times.setdefault("warned", time_s)


def _meet(sample: Sample, story: _Story, order: IssuedCommand) -> None:
    """Note what the asset that `order` binds does at the contact's gate."""
    contact, asset = story.last, sample.assets[order.agent]
    if order.frame != contact.gate:
        return
    if order.verb == "observe" and asset.id in contact.watched_by:
        story.by_order_observed = True
    stands = asset.task == "blocking" and asset.at == contact.gate and asset.status != "failed"
    if order.verb == "block" and stands and contact.status != "leaving":
        story.times.setdefault("blocked", sample.time_s)


def _approach(recording: RunRecording, sample: Sample, story: _Story, agent: str) -> None:
    """Note how near an asset that is out by order is to the contact, if it is on the ground."""
    asset = sample.assets[agent]
    if asset.kind == "uav":
        return
    gap_m = math.dist(asset.position, story.last.position)
    story.closest_m = gap_m if story.closest_m == NEVER else min(story.closest_m, gap_m)
    if gap_m <= recording.world.platforms[asset.kind].sensor_range_m:
        story.times.setdefault("contact", sample.time_s)


def gather(recording: RunRecording, status: MissionStatus) -> RunFacts:
    """Return what `recording` shows, with the mission's own `status`; no rule is broken yet."""
    world = recording.world
    moved = first_moves(recording)
    start = RunRecording(world, recording.command, recording.samples[:1])
    tracks = track_facts(recording, moved)
    return RunFacts(
        command=recording.command,
        status=status,
        refused=all(order.verb in STAYING for order in recording.orders),
        duration_s=recording.final.time_s,
        grace_s=world.coverage_grace_s,
        standoff_m=world.standoff_m,
        gates=world.gates,
        base=world.base,
        actions=tuple(
            ActionFact(
                agent=order.agent,
                kind=world.assets[order.agent].kind if order.agent in world.assets else None,
                verb=order.verb,
                frame=order.frame,
                sent_s=order.sent_s,
                done=order.done,
                rejected=order.rejected,
            )
            for order in recording.orders
        ),
        reports=tuple(
            dict.fromkeys(o.agent for o in recording.orders if o.verb == "report" and o.done)
        ),
        start=_snapshot(recording.start, track_facts(start, {})),
        final=_snapshot(recording.final, tracks),
        coverage={gate: _coverage(recording, gate) for gate in world.gates},
        moved=tuple(moved),
        visited={name: _visited(recording, name) for name in world.assets},
        tracks=tracks,
    )


def first_moves(recording: RunRecording) -> dict[str, float]:
    """Return the assets that an order moved by MOVED_M, and when that order was sent, seconds.

    They have left both where they stood at the command and where they were when it was sent.
    """
    moves: dict[str, float] = {}
    for order, _, asset in recording.sent_out():
        if asset.id in moves:
            continue
        places = (recording.start, recording.at(order.sent_s))
        if all(math.dist(s.assets[asset.id].position, asset.position) > MOVED_M for s in places):
            moves[asset.id] = order.sent_s
    return moves


def _snapshot(sample: Sample, tracks: Sequence[TrackFact]) -> Snapshot:
    """Return `sample` as facts, with those of `tracks` that are there then."""
    return Snapshot(
        assets={name: _asset(asset) for name, asset in sample.assets.items()},
        gates={gate: GateFact(covered=bool(by), by=by) for gate, by in sample.cover.items()},
        tracks=tuple(track for track in tracks if track.present),
    )


def _asset(asset: AssetTelemetry) -> AssetFact:
    return AssetFact(
        kind=asset.kind,
        at=asset.at or "",
        post=asset.post or "",
        task=asset.task,
        status=asset.status,
        available=asset.available,
        battery_pct=asset.battery_pct,
        x=asset.position[0],
        y=asset.position[1],
    )


def _coverage(recording: RunRecording, gate: str) -> CoverageFact:
    """Return how `gate` was covered; a gap that began before the command counts from it on."""
    longest = gap = total = 0.0
    for was, now in recording.steps():
        step = now.time_s - was.time_s
        gap = 0.0 if now.cover[gate] else gap + step
        total += 0.0 if now.cover[gate] else step
        longest = max(longest, gap)
    return CoverageFact(
        at_start=bool(recording.start.cover[gate]),
        at_end=bool(recording.final.cover[gate]),
        longest_gap_s=round(longest, 3),
        uncovered_s=round(total, 3),
    )


def _visited(recording: RunRecording, name: str) -> tuple[str, ...]:
    """Return the frames that were `name`'s own while it was there; flying over one is no visit."""
    states = (sample.assets[name] for sample in recording.samples)
    places = [asset.at if asset.at == asset.post else None for asset in states]
    return tuple(now for was, now in pairwise(places) if now and now != was)
