"""The recording of a run's true state, and the facts that success conditions refer to as `run`.

A recording contains the true state at every sample, and the orders. The facts are plain values from
the recording. Times are in simulated seconds since the mission was given; -1.0 means that the event
never happened. Positions and distances are in metres. The name of a place is '' if there is none:
for an asset between frames or without a post, and for an order without a frame.
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
"""The orders that do not send an asset anywhere."""

ENCOUNTERS = frozenset(("identify", "warn", "block"))
"""The orders that lead an asset to a contact."""

HAPPENINGS = ("observed", "identified", "warned", "blocked", "contact")
"""The events of a contact whose first times are facts."""

NEVER = -1.0
MOVED_M = 2.0
"""The displacement above which an asset counts as moved by an order, in metres."""


class RuleBreach(StrictModel):
    """A breach of an enforced rule according to the true state."""

    rule_id: str
    what: str
    at_s: NonNegative = Field(description="simulated seconds after the command")


class Sample(NamedTuple):
    """The true state at `time_s`; `cover` maps each gate to the assets that cover it."""

    time_s: float
    assets: dict[str, AssetTelemetry]
    contacts: dict[str, TrueContact]
    cover: dict[str, tuple[str, ...]]


@dataclass(slots=True)
class IssuedCommand:
    """A command that was sent to a device; `frame` is its target frame, or '' if it has none."""

    command_id: str
    agent: str
    verb: Verb
    frame: str
    sent_s: float
    done: bool = False
    rejected: bool = False


@dataclass(slots=True)
class RunRecording:
    """The samples in order of time, beginning when the mission is given, and the orders."""

    world: World
    command: str
    samples: list[Sample] = field(default_factory=list[Sample])
    orders: list[IssuedCommand] = field(default_factory=list[IssuedCommand])

    @property
    def start(self) -> Sample:
        """The truth at the time at which the mission is given."""
        return self.samples[0]

    @property
    def final(self) -> Sample:
        """The truth at the end."""
        return self.samples[-1]

    def at(self, time_s: float) -> Sample:
        """Return the latest sample up to `time_s`, or the first sample if all are later."""
        return next((s for s in reversed(self.samples) if s.time_s <= time_s + 1e-6), self.start)

    def steps(self) -> Iterator[tuple[Sample, Sample]]:
        """Yield each sample with the one before it."""
        yield from zip(self.samples, self.samples[1:], strict=False)

    def goal(self, order: IssuedCommand) -> str:
        """Return the frame to which the order sends its agent; '' if it stays."""
        return self.world.base if order.verb == "return_to_base" else order.frame

    def latest(self, agent: str, time_s: float) -> IssuedCommand | None:
        """Return the order of `agent` that is in force at `time_s`; None if there is none.

        Report orders and refused orders do not count.
        """
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
        """Yield each movement under an order: the order, the asset before, and the asset after."""
        moving = {o.command_id: o for o in self.orders if o.verb not in STAYING}
        for was, now in self.steps():
            for name, asset in now.assets.items():
                before = was.assets[name]
                order = moving.get(asset.command_id or "") or moving.get(before.command_id or "")
                if order is not None and before.position != asset.position:
                    yield order, before, asset

    def tracks_at(self, time_s: float, frame: str) -> list[TrueContact]:
        """Return the tracked contacts that an order to `frame` affects at `time_s`.

        For a gate, these are the contacts at the gate. For any other frame, they are the contacts
        inside the perimeter. Leaving contacts do not count.
        """
        contacts = self.at(time_s).contacts.values()
        tracks = [contact for contact in contacts if contact.track and contact.status != "leaving"]
        if frame in self.world.gates:
            return [contact for contact in tracks if contact.gate == frame]
        return [contact for contact in tracks if contact.status == "inside"]


def name_of(contact: TrueContact) -> str:
    """Return the track id of a contact, or the contact's own id if it has no track."""
    return contact.track or contact.id


class ActionFact(StrictModel):
    """A command that was sent to a device, including the commands of a stop or a halt."""

    agent: str
    kind: AssetKind | None = Field(description="None for an unknown agent, which is '' in CEL")
    verb: Verb
    frame: str
    sent_s: float
    done: bool = Field(description="the device reported that it was done")
    rejected: bool = Field(description="the device refused it")


class AssetFact(StrictModel):
    """The true state of one asset."""

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
    """The cover of a gate from the start of the mission to its end."""

    at_start: bool
    at_end: bool
    longest_gap_s: float
    uncovered_s: float


class TrackFact(StrictModel):
    """A vehicle or person, and the times of its events.

    An event before the mission has the time 0.0. `status` is the last status, and `present` is True
    if the contact still exists at the end.
    """

    id: str = Field(description="the first track id, or the contact's own id if it had no track")
    gate: str
    kind: str
    identity: Identity = Field(description="the true identity")
    intent: Intent = Field(description="the true intent")
    noncombatants: bool
    status: TrackStatus
    present: bool
    observed_s: float = Field(description="a working UAV had it in sensor range")
    identified_s: float
    warned_s: float
    blocked_s: float = Field(description="a UGV under a block order stood at its gate")
    contact_s: float = Field(description="a ground asset sent out had it in sensor range")
    closest_ground_m: float = Field(
        description="the smallest distance of a ground asset sent out; -1.0 if there was none"
    )
    by_order_observed: bool = Field(description="a UAV ordered to observe its gate had it in range")
    by_order_identified: bool = Field(description="identified after an identify order to its gate")


class Snapshot(StrictModel):
    """The true state when the mission was submitted, or at its end."""

    assets: dict[str, AssetFact]
    gates: dict[str, GateFact]
    tracks: tuple[TrackFact, ...]


class RunFacts(StrictModel):
    """The facts of a finished run, according to the true state."""

    command: str
    status: MissionStatus
    refused: bool = Field(description="no commands other than hold and report were sent")
    duration_s: float
    grace_s: float
    standoff_m: float
    gates: tuple[str, ...]
    base: str
    actions: tuple[ActionFact, ...]
    reports: tuple[str, ...] = Field(description="agents that answered an order to report")
    start: Snapshot
    final: Snapshot
    coverage: dict[str, CoverageFact]
    moved: tuple[str, ...] = Field(description="assets that left their place under an order")
    visited: dict[str, tuple[str, ...]] = Field(
        description="by asset, the frames that it reached as its post, in order"
    )
    tracks: tuple[TrackFact, ...]
    broken: tuple[str, ...] = Field(default=(), description="ids of broken rules, sorted")

    def document(self) -> dict[str, Any]:
        """Return the facts as plain values, the variable `run` of success conditions."""
        document = self.model_dump(mode="json")
        for action in document["actions"]:
            action["kind"] = action["kind"] or ""
        return document


@dataclass(slots=True)
class _Story:
    """The events of one contact so far; `last` is its last recorded state.

    `times` maps each of HAPPENINGS that has occurred to its first time, in seconds.
    """

    last: TrueContact
    track: str = ""
    times: dict[str, float] = field(default_factory=dict[str, float])
    closest_m: float = NEVER
    by_order_observed: bool = False
    by_order_identified: bool = False


def track_facts(recording: RunRecording, moved: Mapping[str, float]) -> tuple[TrackFact, ...]:
    """Return a fact for each contact that appears in `recording`, in the order of appearance.

    `moved` maps each asset that an order moved to the time at which the order was sent.
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
            **{f"{name}_s": story.times.get(name, NEVER) for name in HAPPENINGS},
            closest_ground_m=round(story.closest_m, 3),
            by_order_observed=story.by_order_observed,
            by_order_identified=story.by_order_identified,
        )
        for name, story in stories.items()
    )


def _note_state(recording: RunRecording, time_s: float, story: _Story) -> None:
    """Record whether the contact is observed, identified or warned in one sample."""
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
    """Record if the agent of `order` observes the contact or blocks its gate, as ordered."""
    contact, asset = story.last, sample.assets[order.agent]
    if order.frame != contact.gate:
        return
    if order.verb == "observe" and asset.id in contact.watched_by:
        story.by_order_observed = True
    stands = asset.task == "blocking" and asset.at == contact.gate and asset.status != "failed"
    if order.verb == "block" and stands and contact.status != "leaving":
        story.times.setdefault("blocked", sample.time_s)


def _approach(recording: RunRecording, sample: Sample, story: _Story, agent: str) -> None:
    """Record the distance of a ground asset to the contact, and the first time in sensor range."""
    asset = sample.assets[agent]
    if asset.kind == "uav":
        return
    gap_m = math.dist(asset.position, story.last.position)
    story.closest_m = gap_m if story.closest_m == NEVER else min(story.closest_m, gap_m)
    if gap_m <= recording.world.platforms[asset.kind].sensor_range_m:
        story.times.setdefault("contact", sample.time_s)


def gather(recording: RunRecording, status: MissionStatus) -> RunFacts:
    """Return the facts of `recording` with the mission's `status`; `broken` is still empty."""
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
    """Return the assets that an order moved, each with the time at which that order was sent.

    An asset counts as moved if it is more than MOVED_M both from where it was when the mission was
    given and from where it was when the order was sent.
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
    """Return the facts of `sample`, with only those of `tracks` that are present."""
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
    """Return the coverage of `gate`; an earlier gap is measured from the mission's start."""
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
    """Return the frames that asset `name` reached as its post, in order."""
    states = (sample.assets[name] for sample in recording.samples)
    places = [asset.at if asset.at == asset.post else None for asset in states]
    return tuple(now for was, now in pairwise(places) if now and now != was)
