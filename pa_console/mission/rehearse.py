"""Step 5: the rehearsal of a plan in a forecast, with a record of what happens on the way."""

import asyncio
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from math import dist

import shapely
from shapely import LineString, Polygon

from pa_console.fleets.fleet import Forecast, Outlook
from pa_console.policy.moments import distinct, moment
from pa_console.policy.rule_variables import goes_to
from pa_console.schema.base import Point
from pa_console.schema.command import FINAL_REPLIES, STILL, CommandReply, DeviceCommand
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import (
    AssetTimeline,
    GateTimeline,
    GuardChange,
    Motion,
    OrderMoment,
    Rehearsal,
    TimedPoint,
    Timeline,
    TrackTimeline,
)
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import World

TOLERANCE_M = 0.5
"""The largest deviation of a recorded way from the rehearsed way, in metres."""

HORIZON_S = 240.0
"""The longest time of a rehearsed step in seconds, not counting its stays."""
SETTLE_S = 2.0
"""The time for which a rehearsal continues after the last command of a step has ended, in
seconds."""
MOST_STEPS_PER_SLICE = 60
ASSET_STEPS_PER_SLICE = 6000
"""The size of a slice as steps times assets, which takes a few milliseconds."""


class MotionRecord:
    """A record of the motion of a plan's agents, of other assets under way, and of tracks.

    The record keeps only the positions at which course or speed changes.
    """

    def __init__(self, world: World, before: Picture, plan: Plan) -> None:
        sent = ((action.agent, goes_to(action, world)) for action in plan.actions)
        self._goals = {agent: goal for agent, goal in sent if goal}
        under_way = (name for name, asset in before.assets.items() if asset.route)
        self._assets = tuple(dict.fromkeys((*plan.agents, *under_way)))
        self._ways: dict[str, _Way] = {}
        self._guards: dict[str, list[GuardChange]] = {}
        self._arrived: dict[str, float] = {}
        self._ended: dict[str, float] = {}
        self.sample(before, 0.0)

    def end(self, agent: str, time_s: float) -> None:
        """Record that a command of an agent has ended."""
        self._ended[agent] = round(time_s, 2)

    def sample(self, picture: Picture, time_s: float) -> None:
        """Record the next picture, `time_s` seconds after the start."""
        time_s = round(time_s, 2)
        for name, position in self._positions(picture):
            way = self._ways.get(name)
            if way is None:
                self._ways[name] = _Way(time_s, position)
            else:
                way.add(time_s, position)
        for agent, goal in self._goals.items():
            if agent not in self._arrived and picture.assets[agent].at == goal:
                self._arrived[agent] = time_s
        for gate, cover in picture.gates.items():
            changes = self._guards.setdefault(gate, [])
            if not changes or changes[-1][1] != cover.by:
                changes.append((time_s, cover.by))

    def _positions(self, picture: Picture) -> Iterator[tuple[str, Point]]:
        for name in self._assets:
            yield name, picture.assets[name].position
        for name, track in picture.tracks.items():
            yield name, track.position

    def result(self) -> Motion:
        """Return the recorded motion; an asset that stood still has no trajectory."""
        ways = {name: way.points() for name, way in self._ways.items()}
        return Motion(
            trajectories={name: points for name, points in ways.items() if len(points) > 1},
            guards={gate: tuple(changes) for gate, changes in self._guards.items()},
            arrived_s=self._arrived,
            ended_s=self._ended,
        )


class _Way:
    """The positions at which one asset or track changes course or speed."""

    def __init__(self, time_s: float, position: Point) -> None:
        self._kept = [(time_s, position)]
        self._last = time_s, position

    def add(self, time_s: float, position: Point) -> None:
        """Add the next position; keep the previous one only if course or speed changes there."""
        (from_s, (x, y)), (last_s, last) = self._kept[-1], self._last
        if last_s > from_s:
            share = (last_s - from_s) / (time_s - from_s)
            expected = x + (position[0] - x) * share, y + (position[1] - y) * share
            if dist(expected, last) > TOLERANCE_M:
                self._kept.append(self._last)
        self._last = time_s, position

    def points(self) -> tuple[TimedPoint, ...]:
        """Return the way so far; a single point if the asset or track has not moved."""
        end = self._last if dist(self._last[1], self._kept[-1][1]) > TOLERANCE_M else None
        kept = [*self._kept, end] if end is not None else self._kept
        return tuple((time_s, round(x, 2), round(y, 2)) for time_s, (x, y) in kept)


def device_commands(plan: Plan, prefix: str) -> tuple[DeviceCommand, ...]:
    """Return the plan's actions as device commands with ids `prefix`.1, `prefix`.2 and so on."""
    return tuple(
        DeviceCommand(
            command_id=f"{prefix}.{number}",
            agent=action.agent,
            verb=action.verb,
            target=action.target,
        )
        for number, action in enumerate(plan.actions, start=1)
    )


def order_moments(plan: Plan, world: World, done: Collection[str]) -> tuple[OrderMoment, ...]:
    """Return the plan's actions for ordering rules; `done` names the agents that have finished."""
    return tuple(
        OrderMoment(
            agent=action.agent,
            kind=world.assets[action.agent].kind,
            verb=action.verb,
            target=action.target,
            done=action.agent in done,
        )
        for action in plan.actions
    )


@dataclass(frozen=True)
class RehearsedSteps:
    """The rehearsal of a plan as a whole, and that of each step that began."""

    whole: Rehearsal
    steps: tuple[Rehearsal, ...]


async def rehearse(outlook: Outlook, plan: Plan) -> Rehearsal:
    """Run `plan` in a forecast and return its rehearsal as a whole."""
    return (await rehearse_steps(outlook, plan)).whole


async def rehearse_steps(outlook: Outlook, plan: Plan) -> RehearsedSteps:
    """Run `plan` in a forecast, step by step; a step takes at most HORIZON_S and its stays.

    The forecast is built from the picture, never from the truth. A step begins at the end of the
    previous step; after a step that does not end, the rehearsal stops. Control returns to the event
    loop after every slice of simulated steps, so that the screen stays responsive.
    """
    forecast, before = outlook.forecast(), outlook.picture()
    rehearsed: list[Rehearsal] = []
    gaps_s: dict[str, float] = {}
    for numbers in plan.steps:
        recorder = _Recorder(forecast.world, before, plan.part(numbers), gaps_s)
        rehearsal = await _rehearse_step(forecast, recorder, plan.part(numbers), len(rehearsed))
        rehearsed.append(rehearsal)
        before, gaps_s = rehearsal.after, recorder.gaps_s
        if not all(line.finished for line in rehearsal.timeline.assets.values()):
            break
    return RehearsedSteps(joined(rehearsed), tuple(rehearsed))


async def _rehearse_step(
    forecast: Forecast, recorder: "_Recorder", plan: Plan, step_before: int
) -> Rehearsal:
    """Run one step of a plan in `forecast`; each step has its own command ids."""
    commands = device_commands(plan, f"rehearsal{step_before or ''}")
    stay_s = max((action.stay_s for action in plan.actions), default=0.0)
    for command in commands:
        forecast.send(command)
    pending = {command.command_id for command in commands}
    start, end = forecast.time_s, None
    few = ASSET_STEPS_PER_SLICE // len(forecast.world.assets)
    steps_per_slice = min(max(few, 1), MOST_STEPS_PER_SLICE)
    every = max(1, round(forecast.world.telemetry_period_s / forecast.world.dt_s))
    for step in range(1, round((HORIZON_S + stay_s) / forecast.world.dt_s) + 1):
        for reply in forecast.step():
            recorder.reply(reply, forecast.time_s - start)
            if reply.status in FINAL_REPLIES:
                pending.discard(reply.command_id)
        if not pending and end is None:
            end = forecast.time_s + max(SETTLE_S, stay_s)
        if step % every == 0:
            recorder.sample(forecast.picture(), forecast.time_s - start)
            if end is not None and forecast.time_s >= end:
                break
        if step % steps_per_slice == 0:
            await asyncio.sleep(0)
    return recorder.result(forecast.time_s - start)


@dataclass
class _AssetLog:
    finished: bool = False
    detail: str = "not finished within the rehearsal"
    left_perimeter: bool = False
    zones: list[str] = field(default_factory=list[str])
    least_battery: float = 100.0
    travelled: float = 0.0


@dataclass
class _TrackLog:
    observed: float | None = None
    contact: float | None = None
    identified: float | None = None
    warned: float | None = None
    blocked: float | None = None
    least: float | None = None


class _Recorder:
    """The timeline of a rehearsal, collected from successive pictures of the forecast."""

    def __init__(
        self, world: World, before: Picture, plan: Plan, gaps_s: Mapping[str, float]
    ) -> None:
        """Begin with the picture `before`; `gaps_s` maps gates to the time uncovered so far."""
        self._world, self._before, self._last = world, before, before
        self._plan = plan
        self._moments = [moment(before, world, (), plan.agents)]
        self._agents = {action.agent: _AssetLog() for action in plan.actions}
        self._motion = MotionRecord(world, before, plan)
        self._movers = {a.agent for a in plan.actions if a.verb not in STILL}
        self._tracks: dict[str, _TrackLog] = {name: _TrackLog() for name in before.tracks}
        self.gaps_s = {gate: gaps_s.get(gate, 0.0) for gate in world.gates}
        """The time for which each gate has now been without cover in the rehearsal, in seconds."""
        self._longest = dict.fromkeys(world.gates, 0.0)
        self._time = 0.0
        self._orders: tuple[OrderMoment, ...] = ()
        self._done: set[str] | None = None
        self._inside = Polygon(world.perimeter).buffer(1.0)
        self._zones = {name: Polygon(zone.polygon) for name, zone in world.zones.items()}
        for area in (self._inside, *self._zones.values()):
            shapely.prepare(area)
        for track in before.tracks.values():
            self._look_at(track, before, 0.0)

    def reply(self, reply: CommandReply, time_s: float) -> None:
        log = self._agents.get(reply.agent)
        if log is not None and reply.status in FINAL_REPLIES:
            log.finished, log.detail = reply.status == "done", reply.detail
            self._motion.end(reply.agent, time_s)

    def sample(self, picture: Picture, time_s: float) -> None:
        for gate, cover in picture.gates.items():
            bare_s = 0.0 if cover.covered else self.gaps_s[gate] + time_s - self._time
            self.gaps_s[gate] = bare_s
            self._longest[gate] = max(self._longest[gate], bare_s)
        for name, log in self._agents.items():
            self._follow(log, self._last.assets[name], picture.assets[name])
        for track in picture.tracks.values():
            self._look_at(track, picture, time_s)
        self._motion.sample(picture, time_s)
        self._last, self._time = picture, time_s
        done = {name for name, log in self._agents.items() if log.finished}
        if done != self._done:
            self._done, self._orders = done, order_moments(self._plan, self._world, done)
        self._moments.append(moment(picture, self._world, self._orders, self._plan.agents))

    def _follow(self, log: _AssetLog, was: AssetTelemetry, now: AssetTelemetry) -> None:
        log.least_battery = min(log.least_battery, now.battery_pct)
        if was.position == now.position:
            return
        log.travelled += _gap_m(was.position, now.position)
        if not shapely.intersects_xy(self._inside, *now.position):
            log.left_perimeter = True
        for name, zone in self._zones.items():
            if name not in log.zones and _enters(zone, was.position, now.position):
                log.zones.append(name)

    def _look_at(self, track: Track, picture: Picture, time_s: float) -> None:
        log = self._tracks.setdefault(track.id, _TrackLog())
        ground = [
            (asset, _gap_m(asset.position, track.position))
            for name in self._movers
            if (asset := picture.assets[name]).kind != "uav" and asset.available
        ]
        near = any(gap <= self._world.platforms[a.kind].sensor_range_m for a, gap in ground)
        blocking = any(a.task == "blocking" and a.at == track.gate for a, _ in ground)
        log.observed = _first(log.observed, track.observed, time_s)
        log.contact = _first(log.contact, near, time_s)
        log.identified = _first(log.identified, track.identity != "unknown", time_s)
        log.warned = _first(log.warned, track.warned, time_s)
        log.blocked = _first(log.blocked, blocking, time_s)
        if track.identity == "unknown" and ground:
            closest = min(gap for _, gap in ground)
            log.least = closest if log.least is None else min(log.least, closest)

    def result(self, duration_s: float) -> Rehearsal:
        after = self._last
        return Rehearsal(
            before=self._before,
            after=after,
            moments=distinct(self._moments),
            motion=self._motion.result(),
            timeline=Timeline(
                duration_s=duration_s,
                gates={
                    gate: GateTimeline(
                        covered_before=self._before.gates[gate].covered,
                        covered_after=after.gates[gate].covered,
                        longest_gap_s=self._longest[gate],
                    )
                    for gate in self._world.gates
                },
                tracks={
                    name: TrackTimeline(
                        observed_s=log.observed,
                        ground_contact_s=log.contact,
                        identified_s=log.identified,
                        warned_s=log.warned,
                        blocked_s=log.blocked,
                        least_distance_m=log.least,
                    )
                    for name, log in self._tracks.items()
                },
                assets={
                    name: AssetTimeline(
                        finished=log.finished,
                        detail="" if log.finished else log.detail,
                        left_perimeter=log.left_perimeter,
                        entered_zones=tuple(log.zones),
                        least_battery_pct=log.least_battery,
                        travelled_m=log.travelled,
                    )
                    for name, log in self._agents.items()
                },
            ),
        )


def _first(earlier: float | None, now: bool, time_s: float) -> float | None:
    return time_s if earlier is None and now else earlier


def _gap_m(here: Point, there: Point) -> float:
    dx, dy = there[0] - here[0], there[1] - here[1]
    return math.sqrt(dx * dx + dy * dy)


def _enters(zone: Polygon, here: Point, there: Point) -> bool:
    """Return whether the straight way between two points enters `zone` from outside."""
    left, low, right, high = zone.bounds
    (ax, ay), (bx, by) = here, there
    if max(ax, bx) < left or min(ax, bx) > right or max(ay, by) < low or min(ay, by) > high:
        return False
    return bool(zone.intersects(LineString((here, there)))) and not shapely.contains_xy(
        zone, ax, ay
    )


# Joining the rehearsals of successive steps


def joined(steps: Sequence[Rehearsal]) -> Rehearsal:
    """Return the rehearsals of successive steps as one rehearsal."""
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


def _later_track(before: TrackTimeline | None, new: TrackTimeline, start_s: float) -> TrackTimeline:
    """Return the times of a track's events in earlier steps and in one that begins at `start_s`."""
    times = {
        name: None if at is None else at + start_s
        for name, at in new.model_dump(exclude={"least_distance_m"}).items()
    }
    least = new.least_distance_m
    if before is not None:
        earlier = before.model_dump(exclude={"least_distance_m"})
        times |= {name: at for name, at in earlier.items() if at is not None}
        both = [gap for gap in (before.least_distance_m, least) if gap is not None]
        least = min(both, default=None)
    return TrackTimeline(**times, least_distance_m=least)


def _later_asset(before: AssetTimeline, new: AssetTimeline) -> AssetTimeline:
    return AssetTimeline(
        finished=before.finished and new.finished,
        detail=before.detail or new.detail,
        left_perimeter=before.left_perimeter or new.left_perimeter,
        entered_zones=tuple(dict.fromkeys((*before.entered_zones, *new.entered_zones))),
        least_battery_pct=min(before.least_battery_pct, new.least_battery_pct),
        travelled_m=before.travelled_m + new.travelled_m,
    )


def _joined_motion(steps: Sequence[tuple[float, Rehearsal]]) -> Motion:
    """Join the motions of `steps`, each given with its start in seconds.

    Only the last arrival of each agent is kept.
    """
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
            earlier = guards.get(gate, ())
            new = [(round(at + start_s, 2), by) for at, by in changes]
            guards[gate] = (
                *earlier,
                *(new[1:] if earlier and earlier[-1][1] == new[0][1] else new),
            )
        arrived |= {name: round(at + start_s, 2) for name, at in motion.arrived_s.items()}
        ended |= {name: round(at + start_s, 2) for name, at in motion.ended_s.items()}
    return Motion(trajectories=ways, guards=guards, arrived_s=arrived, ended_s=ended)
