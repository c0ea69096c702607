"""Records where everything is while a plan is rehearsed, and who covers which gate."""

from collections.abc import Iterator
from math import dist

from pa_console.policy.checks.check_context import goes_to
from pa_console.schema.base import Point
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import GuardChange, Motion, TimedPoint
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World

TOLERANCE_M = 0.5
"""A recorded way is at most about so far from the rehearsed one."""


class MotionRecord:
    """Follows the agents of a plan, whatever else is under way, and the tracks.

    Of their positions it keeps those at which way or speed change.
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
        """Note that a command of an agent has ended."""
        self._ended[agent] = round(time_s, 2)

    def sample(self, picture: Picture, time_s: float) -> None:
        """Take in the next picture, `time_s` seconds after the start."""
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
            known = self._guards.setdefault(gate, [])
            if not known or known[-1][1] != cover.by:
                known.append((time_s, cover.by))

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
    """The positions of one thing, those left out that lie on an even straight way."""

    def __init__(self, time_s: float, position: Point) -> None:
        self._kept = [(time_s, position)]
        self._last = time_s, position

    def add(self, time_s: float, position: Point) -> None:
        """Take in the next position; the one before is kept if the way bends there."""
        (from_s, (x, y)), (last_s, last) = self._kept[-1], self._last
        if last_s > from_s:
            share = (last_s - from_s) / (time_s - from_s)
            expected = x + (position[0] - x) * share, y + (position[1] - y) * share
            if dist(expected, last) > TOLERANCE_M:
                self._kept.append(self._last)
        self._last = time_s, position

    def points(self) -> tuple[TimedPoint, ...]:
        """Return the way so far; one point only where nothing has moved."""
        end = self._last if dist(self._last[1], self._kept[-1][1]) > TOLERANCE_M else None
        kept = [*self._kept, end] if end is not None else self._kept
        return tuple((time_s, round(x, 2), round(y, 2)) for time_s, (x, y) in kept)
