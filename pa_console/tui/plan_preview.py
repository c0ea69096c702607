"""A preview of a rehearsed plan: routes, arrivals, cover of gates, and the picture at a moment.

The playback is slow enough to follow.
"""

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, takewhile
from math import atan2, degrees, dist

from pa_console.schema.base import Point
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal, TimedPoint
from pa_console.schema.telemetry import GateCover, Picture
from pa_console.schema.world import World
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.surroundings import SecondsClock

MOVED_M = 1.0
"""The maximum distance from its start, in metres, of an asset that counts as not moved."""

LONGEST_S = 8.0
"""The longest playback of a rehearsal, in seconds."""

STAYS_S = 1.5
"""The time for which the end of a playback stays on the screen, in seconds."""


@dataclass(frozen=True)
class CoverChange:
    """The number of a gate's guards before and after a plan, and the longest time without any."""

    before: int
    after: int
    longest_gap_s: float

    @property
    def loses(self) -> bool:
        """True if the gate ends with fewer guards, or has none for a time."""
        return self.after < self.before or self.longest_gap_s > 0.0


@dataclass(frozen=True)
class PlanPreview:
    """A plan and its rehearsal; all times are in seconds from the start of the plan.

    `reading` is the reading of the order in plain words, unless this is the plan that waits.
    """

    world: World
    plan: Plan
    rehearsal: Rehearsal
    reading: str = ""

    @property
    def before(self) -> Picture:
        """The picture at the start of the rehearsal."""
        return self.rehearsal.before

    @property
    def duration_s(self) -> float:
        """The duration of the rehearsal, in seconds."""
        return self.rehearsal.timeline.duration_s

    @cached_property
    def goals(self) -> Mapping[str, str]:
        """The destination of every agent that is sent to a place."""
        sent = ((action.agent, self.goal(action)) for action in self.plan.actions)
        return {agent: goal for agent, goal in sent if goal}

    def goal(self, action: Action) -> str:
        """Return the destination of an action; '' if its agent stays in place."""
        return self.world.base if action.verb == "return_to_base" else action.target or ""

    @cached_property
    def ways(self) -> Mapping[str, tuple[TimedPoint, ...]]:
        """The route of everything that moves; straight lines if no routes were recorded."""
        return self.rehearsal.motion.trajectories or dict(self._straight_ways())

    def _straight_ways(self) -> Iterator[tuple[str, tuple[TimedPoint, ...]]]:
        for name, asset in self.before.assets.items():
            then = self.rehearsal.after.assets.get(name, asset)
            if then.position != asset.position:
                yield name, ((0.0, *asset.position), (self.duration_s, *then.position))

    def is_there(self, action: Action) -> bool:
        """Return whether the agent is at the action's place already, or stays in place."""
        goal, asset = self.goal(action), self.before.assets.get(action.agent)
        return not goal or (asset is not None and asset.at == goal)

    def arrival_s(self, agent: str, place: str = "") -> float | None:
        """Return when an agent arrives, or when its command ends; None if it never does.

        For an agent with several destinations, return when it first reaches `place`.
        """
        if place and sum(action.agent == agent for action in self.plan.actions) > 1:
            frame, way = self.world.frames[place], self.ways.get(agent, ())
            there = (time_s for time_s, *at in way if dist(at, frame.at) <= frame.radius_m)
            return next(there, None)
        motion = self.rehearsal.motion
        return motion.arrived_s.get(agent, motion.ended_s.get(agent))

    def departure_s(self, agent: str) -> float:
        """Return when an agent sets out: at once, unless its first action follows other actions."""
        first = next((action for action in self.plan.actions if action.agent == agent), None)
        way = self.ways.get(agent, ())
        if first is None or not first.after or not way:
            return 0.0
        start = way[0][1:]
        waits = takewhile(lambda point: dist(point[1:], start) < MOVED_M, way)
        return max(time_s for time_s, *_ in waits)

    def finished(self, agent: str) -> bool:
        """Return whether an agent finished its command in the rehearsal."""
        line = self.rehearsal.timeline.assets.get(agent)
        return line is not None and line.finished

    @cached_property
    def arrivals(self) -> Mapping[str, tuple[str, ...]]:
        """The agents that arrive at each place, soonest first, except those already there."""
        agents: dict[str, list[str]] = {}
        for action in self.plan.actions:
            if not self.is_there(action):
                agents.setdefault(self.goal(action), []).append(action.agent)
        return {
            place: tuple(sorted(dict.fromkeys(names), key=self._soonest))
            for place, names in agents.items()
        }

    def _soonest(self, agent: str) -> float:
        at = self.arrival_s(agent)
        return float("inf") if at is None else at

    @cached_property
    def cover_changes(self) -> Mapping[str, CoverChange]:
        """The gates whose number of guards changes, and gates that lose all guards for a time."""
        changes: dict[str, CoverChange] = {}
        for gate, line in self.rehearsal.timeline.gates.items():
            before = len(self.guards_at(gate, 0.0))
            after = len(self.guards_at(gate, self.duration_s))
            gap_s = line.longest_gap_s if line.covered_before else 0.0
            if before != after or gap_s > 0.0:
                changes[gate] = CoverChange(before, after, gap_s)
        return changes

    @cached_property
    def involved(self) -> frozenset[str]:
        """The agents, their destinations, gates with changed cover, and tracks at these places."""
        places = {*self.goals.values(), *self.cover_changes}
        tracks = (name for name, track in self.before.tracks.items() if track.gate in places)
        return frozenset((*self.plan.agents, *places, *tracks))

    def guards_at(self, gate: str, time_s: float) -> tuple[str, ...]:
        """Return the assets that cover a gate at `time_s`."""
        changes = self.rehearsal.motion.guards.get(gate, ())
        if not changes:
            picture = self.before if time_s < self.duration_s else self.rehearsal.after
            return picture.gates[gate].by if gate in picture.gates else ()
        return changes[max(bisect_right([at for at, _ in changes], time_s) - 1, 0)][1]

    def way_left(self, name: str, time_s: float) -> list[Point]:
        """Return the rest of a route from `time_s` on; empty if the route has ended by then."""
        way = self.ways.get(name, ())
        if not way or time_s >= way[-1][0]:
            return []
        return [_at(way, time_s), *((x, y) for at, x, y in way if at > time_s)]

    def picture_at(self, time_s: float) -> Picture:
        """Return the picture at a moment of the plan, as far as it was recorded.

        Its clock does not advance, so that no report is older than at the time of the rehearsal.
        """
        if time_s >= self.duration_s:
            return self.rehearsal.after
        before = self.before
        assets, tracks = dict(before.assets), dict(before.tracks)
        for name, way in self.ways.items():
            there: dict[str, object] = {"position": _at(way, time_s)}
            if name in assets:
                there |= {"heading_deg": _heading(way, time_s), "route": ()}
                assets[name] = assets[name].model_copy(update=there)
            elif name in tracks:
                tracks[name] = tracks[name].model_copy(update=there)
        gates = {gate: self._cover(gate, cover, time_s) for gate, cover in before.gates.items()}
        return before.model_copy(update={"assets": assets, "tracks": tracks, "gates": gates})

    def _cover(self, gate: str, cover: GateCover, time_s: float) -> GateCover:
        if len(self.rehearsal.motion.guards.get(gate, ())) <= 1:
            return cover
        by = self.guards_at(gate, time_s)
        return cover.model_copy(update={"covered": bool(by), "by": by})


def waiting_plan(world: World, trace: MissionTrace) -> PlanPreview | None:
    """Return a preview of the plan that waits for a decision; None if it has no rehearsal."""
    request = trace.approval
    attempt = trace.find(request.attempt) if request is not None else None
    if request is None or attempt is None or attempt.rehearsal is None:
        return None
    return PlanPreview(world, request.plan, attempt.rehearsal)


def _at(way: tuple[TimedPoint, ...], time_s: float) -> Point:
    """Return the position on a route at `time_s`."""
    if time_s <= way[0][0]:
        return way[0][1:]
    for (from_s, x, y), (to_s, far_x, far_y) in pairwise(way):
        if time_s < to_s:
            share = (time_s - from_s) / (to_s - from_s)
            return x + (far_x - x) * share, y + (far_y - y) * share
    return way[-1][1:]


def _heading(way: tuple[TimedPoint, ...], time_s: float) -> float:
    """Return the direction of travel on a route at `time_s`, in degrees: 0 is east, 90 is north."""
    for (_, x, y), (to_s, far_x, far_y) in pairwise(way):
        if time_s < to_s or to_s == way[-1][0]:
            return degrees(atan2(far_y - y, far_x - x))
    return 0.0


@dataclass(frozen=True)
class Playback:
    """The playback of a rehearsal, which began at `began_s` on the `clock`."""

    preview: PlanPreview
    clock: SecondsClock
    began_s: float

    @property
    def _played_s(self) -> float:
        return self.clock() - self.began_s

    @property
    def _plays_s(self) -> float:
        return min(self.preview.duration_s, LONGEST_S)

    @property
    def time_s(self) -> float:
        """The moment of the plan on the screen, in seconds from the plan's start."""
        share = self._played_s / self._plays_s if self._plays_s else 1.0
        return min(share, 1.0) * self.preview.duration_s

    @property
    def is_over(self) -> bool:
        """True if the end has been shown for long enough."""
        return self._played_s >= self._plays_s + STAYS_S
