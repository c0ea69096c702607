"""What a plan comes to if every order simply succeeds: a rehearsal without a simulation."""

import math
from collections.abc import Iterator

from shapely import Point, Polygon

from pa_console.orchestrator.rehearsal import order_moments
from pa_console.policy.context import goes_to
from pa_console.policy.moments import moment
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import (
    AssetTimeline,
    GateTimeline,
    Rehearsal,
    Timeline,
    TrackTimeline,
)
from pa_console.schema.telemetry import GateCover, Picture, Track
from pa_console.schema.world import World


def assume_done(before: Picture, world: World, plan: Plan) -> Rehearsal:
    """Return the picture after `plan` as if everybody were at once where he is sent.

    For the ablation without rehearsal: nothing can happen on the way, so no gap, obstacle or
    encounter is found, and no zone but one that somebody is sent into. The duration is the longest
    straight way at full speed, in seconds.
    """
    goals = {a.agent: goal for a in plan.actions if (goal := goes_to(a, world))}
    assets = {
        name: asset.model_copy(
            update={"at": goals[name], "post": goals[name], "position": _at(world, goals[name])}
        )
        if name in goals and asset.available
        else asset
        for name, asset in before.assets.items()
    }
    by: dict[str, list[str]] = {gate: [] for gate in before.gates}
    for name, asset in assets.items():
        if asset.available and asset.at in by and asset.post == asset.at:
            by[asset.at].append(name)
    after = before.model_copy(
        update={
            "assets": assets,
            "gates": {g: GateCover(covered=bool(n), by=tuple(n)) for g, n in by.items()},
        }
    )
    agents = plan.agents
    done = order_moments(plan, world, agents)
    return Rehearsal(
        before=before,
        after=after,
        moments=(moment(before, world, (), agents), moment(after, world, done, agents)),
        timeline=Timeline(
            duration_s=max(_seconds(before, world, goals), default=0.0),
            gates={
                gate: GateTimeline(
                    covered_before=before.gates[gate].covered,
                    covered_after=after.gates[gate].covered,
                    longest_gap_s=0.0,
                )
                for gate in before.gates
            },
            tracks={name: _handled(track, plan) for name, track in before.tracks.items()},
            assets={
                name: AssetTimeline(finished=True, entered_zones=_entered(world, goals.get(name)))
                for name in agents
            },
        ),
    )


def _handled(track: Track, plan: Plan) -> TrackTimeline:
    """Return what the orders for the track's gate would make known of it, all at once."""
    verbs = {action.verb for action in plan.actions if action.target == track.gate}

    def when(known: bool) -> float | None:
        return 0.0 if known else None

    return TrackTimeline(
        observed_s=when(track.observed or "observe" in verbs),
        identified_s=when(track.identity != "unknown" or "identify" in verbs),
        warned_s=when(track.warned or "warn" in verbs),
        blocked_s=when("block" in verbs),
    )


def _entered(world: World, goal: str | None) -> tuple[str, ...]:
    """Return the zones in which the frame `goal` lies."""
    if goal is None:
        return ()
    point = Point(_at(world, goal))
    return tuple(n for n, zone in world.zones.items() if Polygon(zone.polygon).covers(point))


def _at(world: World, frame: str) -> tuple[float, float]:
    return world.frames[frame].at


def _seconds(before: Picture, world: World, goals: dict[str, str]) -> Iterator[float]:
    for name, goal in goals.items():
        asset = before.assets[name]
        speed = world.platforms[asset.kind].speed_mps
        yield math.dist(asset.position, _at(world, goal)) / speed
