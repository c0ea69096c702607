"""Joins the rehearsals of successive steps into that of the whole plan."""

from collections.abc import Sequence
from itertools import accumulate

from pa_console.policy.moments import distinct
from pa_console.schema.rehearsal import (
    AssetTimeline,
    GateTimeline,
    GuardChange,
    Motion,
    Rehearsal,
    TimedPoint,
    Timeline,
    TrackTimeline,
)


def joined(steps: Sequence[Rehearsal]) -> Rehearsal:
    """Return the rehearsals of steps that follow each other as one."""
    first, last = steps[0], steps[-1]
    if first is last:
        return first
    starts = [0.0, *accumulate(step.timeline.duration_s for step in steps)]
    timed = list(zip(starts, steps, strict=False))
    gates = {
        gate: GateTimeline(
            covered_before=line.covered_before,
            covered_after=last.timeline.gates[gate].covered_after,
            longest_gap_s=max(step.timeline.gates[gate].longest_gap_s for step in steps),
        )
        for gate, line in first.timeline.gates.items()
    }
    tracks: dict[str, TrackTimeline] = {}
    assets: dict[str, AssetTimeline] = {}
    for start_s, step in timed:
        for name, track in step.timeline.tracks.items():
            tracks[name] = _later_track(tracks.get(name), track, start_s)
        for name, line in step.timeline.assets.items():
            assets[name] = _later_asset(assets[name], line) if name in assets else line
    return Rehearsal(
        before=first.before,
        after=last.after,
        moments=distinct(moment for step in steps for moment in step.moments),
        motion=_joined_motion(timed),
        timeline=Timeline(duration_s=starts[-1], gates=gates, tracks=tracks, assets=assets),
    )


def _later_track(known: TrackTimeline | None, new: TrackTimeline, start_s: float) -> TrackTimeline:
    """Return when things first happened to a track by a step that begins at `start_s`."""
    times = {
        name: None if at is None else at + start_s
        for name, at in new.model_dump(exclude={"least_distance_m"}).items()
    }
    least = new.least_distance_m
    if known is not None:
        earlier = known.model_dump(exclude={"least_distance_m"})
        times |= {name: at for name, at in earlier.items() if at is not None}
        both = [gap for gap in (known.least_distance_m, least) if gap is not None]
        least = min(both, default=None)
    return TrackTimeline(**times, least_distance_m=least)


def _later_asset(known: AssetTimeline, new: AssetTimeline) -> AssetTimeline:
    return AssetTimeline(
        finished=known.finished and new.finished,
        detail=known.detail or new.detail,
        left_perimeter=known.left_perimeter or new.left_perimeter,
        entered_zones=tuple(dict.fromkeys((*known.entered_zones, *new.entered_zones))),
        least_battery_pct=min(known.least_battery_pct, new.least_battery_pct),
        travelled_m=known.travelled_m + new.travelled_m,
    )


def _joined_motion(steps: Sequence[tuple[float, Rehearsal]]) -> Motion:
    """Return the motion of steps, each with its start; of an agent, the last arrival counts."""
    ways: dict[str, tuple[TimedPoint, ...]] = {}
    guards: dict[str, tuple[GuardChange, ...]] = {}
    arrived: dict[str, float] = {}
    ended: dict[str, float] = {}
    for start_s, step in steps:
        motion = step.motion
        for name, points in motion.trajectories.items():
            later = tuple((round(at + start_s, 2), x, y) for at, x, y in points)
            ways[name] = (*ways.get(name, ()), *later)
        for gate, changes in motion.guards.items():
            known = guards.get(gate, ())
            new = [(round(at + start_s, 2), by) for at, by in changes]
            guards[gate] = (*known, *(new[1:] if known and known[-1][1] == new[0][1] else new))
        arrived |= {name: round(at + start_s, 2) for name, at in motion.arrived_s.items()}
        ended |= {name: round(at + start_s, 2) for name, at in motion.ended_s.items()}
    return Motion(trajectories=ways, guards=guards, arrived_s=arrived, ended_s=ended)
