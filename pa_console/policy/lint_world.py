"""The small world that lint searches: a few frames and assets of the given one, in any situation.

Nothing is simulated: whoever can go is where he is sent when the plan has ended.
"""

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

from pa_console.policy.context import goes_to
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import (
    AssetTimeline,
    GateTimeline,
    Rehearsal,
    Timeline,
    TrackTimeline,
)
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Track
from pa_console.schema.world import World

GATES = 4
POSTS = 1
EACH_KIND = 3
NOW_S = 100.0
DURATION_S = 60.0
ARRIVES_S = {"uav": 10.0, "ugv": 30.0, "robot": 30.0}
OUTSIDE_M = 40.0


def small_world(world: World, named: Collection[str]) -> World:
    """Return `world` with few gates, posts and assets; those that are `named` are kept first.

    An asset whose post is left out stands at the first frame that is kept.
    """
    base = [world.base]
    posts = [name for name, frame in world.frames.items() if frame.kind == "post"]
    kept = [*base, *_first(world.gates, named, GATES), *_first(posts, named, POSTS)]
    frames = {name: frame for name, frame in world.frames.items() if name in kept}
    assets = {
        name: asset if asset.post in frames else asset.model_copy(update={"post": kept[1]})
        for kind in world.platforms
        for name in _first([n for n, a in world.assets.items() if a.kind == kind], named, EACH_KIND)
        for asset in (world.assets[name],)
    }
    lanes = {name: lane for name, lane in world.lanes.items() if lane.gate in frames}
    cameras = {name: camera for name, camera in world.cameras.items() if camera.gate in frames}
    update = {"frames": frames, "assets": assets, "lanes": lanes, "cameras": cameras}
    return world.model_copy(update=update)


def _first(names: Iterable[str], named: Collection[str], most: int) -> list[str]:
    ordered = sorted(names, key=lambda name: name not in named)
    mentioned = sum(name in named for name in ordered)
    return ordered[: max(most, mentioned)]


@dataclass
class Situation:
    """What is out of the ordinary at one moment, and what a rehearsal happened to show of it.

    Values are fields of the models that they stand for, by name; what is not said is ordinary.
    """

    assets: dict[str, dict[str, object]] = field(default_factory=dict[str, dict[str, object]])
    tracks: dict[str, dict[str, object]] = field(default_factory=dict[str, dict[str, object]])
    course: dict[str, dict[str, object]] = field(default_factory=dict[str, dict[str, object]])
    """What happens to assets on the way, and to tracks."""

    @property
    def words(self) -> str:
        """The situation for a person to read."""
        parts = [
            f"{name} {' '.join(f'{key}={value}' for key, value in facts.items())}"
            for group in (self.assets, self.tracks)
            for name, facts in group.items()
        ]
        return "; ".join(parts) or "nothing out of the ordinary"


def rehearsal_of(world: World, situation: Situation, plan: Plan) -> Rehearsal:
    """Return the picture of `situation` and what `plan` brings about in it."""
    assets = {name: _asset(world, name, situation.assets.get(name, {})) for name in world.assets}
    tracks = {name: _track(world, name, facts) for name, facts in situation.tracks.items()}
    before = Picture(
        tick=0, time_s=NOW_S, assets=assets, tracks=tracks, gates=_covers(world, assets)
    )
    goals = {action.agent: goes_to(action, world) for action in plan.actions}
    moved = {
        name: asset.model_copy(update={"at": goal, "post": goal, "position": world.frames[goal].at})
        for name, asset in assets.items()
        if (goal := goals.get(name, "")) in world.frames and asset.available
    }
    later = assets | moved
    after = before.model_copy(
        update={"time_s": NOW_S + DURATION_S, "assets": later, "gates": _covers(world, later)}
    )
    return Rehearsal(
        before=before, after=after, timeline=_timeline(world, situation, plan, before, after)
    )


def _timeline(
    world: World, situation: Situation, plan: Plan, before: Picture, after: Picture
) -> Timeline:
    def gate(name: str) -> GateTimeline:
        was, now = before.gates[name].covered, after.gates[name].covered
        return GateTimeline(
            covered_before=was, covered_after=now, longest_gap_s=0.0 if now else DURATION_S
        )

    def track(seen: Track) -> TrackTimeline:
        kinds = {
            world.assets[action.agent].kind
            for action in plan.actions
            if action.agent in world.assets and goes_to(action, world) == seen.gate
        }
        ground = [ARRIVES_S[kind] for kind in sorted(kinds) if kind != "uav"]
        known = TrackTimeline(
            observed_s=0.0 if seen.observed else ARRIVES_S["uav"] if "uav" in kinds else None,
            ground_contact_s=ground[0] if ground else None,
        )
        return known.model_copy(update=situation.course.get(seen.id, {}))

    def asset(name: str) -> AssetTimeline:
        known = before.assets[name]
        detail = "" if known.available else f"{name} is not available"
        outcome = AssetTimeline(
            finished=known.available, detail=detail, least_battery_pct=known.battery_pct
        )
        return outcome.model_copy(update=situation.course.get(name, {}))

    return Timeline(
        duration_s=DURATION_S,
        gates={name: gate(name) for name in world.gates},
        tracks={name: track(seen) for name, seen in before.tracks.items()},
        assets={name: asset(name) for name in dict.fromkeys(plan.agents) if name in before.assets},
    )


def _asset(world: World, name: str, facts: dict[str, object]) -> AssetTelemetry:
    spec = world.assets[name]
    at = facts.get("at", spec.post)
    known = AssetTelemetry(
        id=name,
        kind=spec.kind,
        at=spec.post,
        post=spec.post,
        position=world.frames[at if isinstance(at, str) else world.base].at,
        heading_deg=0.0,
        speed_mps=0.0,
        status="ok",
        task="idle",
        battery_pct=90.0,
        low_battery=False,
        comms="ok",
        available=True,
        stamp_s=NOW_S,
    ).model_copy(update={"post": at, **facts})
    usable = known.status != "failed" and known.comms != "lost" and known.battery_pct > 0.0
    sound = not known.stale and known.integrity == "ok"
    low = known.battery_pct < world.low_battery_pct
    return known.model_copy(update={"available": usable and sound, "low_battery": low})


def _track(world: World, name: str, facts: dict[str, object]) -> Track:
    gate = world.frames[str(facts["gate"])].at
    stretch = 1.0 + OUTSIDE_M / max(math.hypot(*gate), 1.0)
    return Track(
        id=name,
        kind="vehicle",
        gate=str(facts["gate"]),
        position=(gate[0] * stretch, gate[1] * stretch),
        heading_deg=0.0,
        speed_mps=5.0,
        distance_m=OUTSIDE_M,
        stamp_s=NOW_S,
    ).model_copy(update=facts)


def _covers(world: World, assets: dict[str, AssetTelemetry]) -> dict[str, GateCover]:
    covers: dict[str, GateCover] = {}
    for gate in world.gates:
        by = [n for n, a in assets.items() if a.available and a.at == a.post == gate]
        covers[gate] = GateCover(covered=bool(by), by=tuple(by))
    return covers
