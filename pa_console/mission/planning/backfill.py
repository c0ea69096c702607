"""Commands added to a plan so that gates stay covered and unknown tracks are observed.

If the last guard leaves a gate, another asset replaces it (WF-03). If the gap would be too long,
the guard waits for its relief. If a ground asset goes to an unknown track, a drone observes that
track (WF-02).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from pa_console.language.canonical.order import Ask
from pa_console.mission.planning.moves import PlanMoves
from pa_console.mission.planning.obstacles import unfit
from pa_console.policy.rule_variables import goes_to
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import AssetKind, World

_MOST_RELIEFS = 3
"""The number of candidates that are tried for each place that needs an asset."""
_DETOUR = 1.2
"""The assumed length of a way, as a multiple of the straight distance."""

Moves = Mapping[str, str]
"""The destination of each agent, as the name of a frame."""
Commands = tuple[tuple[str, str], ...]
"""Pairs of an agent and its command."""


@dataclass(frozen=True)
class StandingAssets(PlanMoves):
    """The assets before a plan; those `named` in the order are not free for other tasks."""

    named: frozenset[str] = frozenset()

    def free(self, kind: AssetKind | None = None) -> list[str]:
        """Return the unnamed assets that could be sent, of `kind` if given."""
        return [name for name in super().free(kind) if name not in self.named]

    def near(self, place: str, kind: AssetKind) -> tuple[str, ...]:
        """Return the unnamed assets of `kind` at `place`, then the free assets of that kind."""
        there = (name for name in self.there(place, kind) if name not in self.named)
        return tuple(dict.fromkeys((*there, *self.free(kind))))

    def fit(self, ask: Ask) -> list[str]:
        """Return those of the assets named in `ask` that can do their part of it."""
        return [n for n in ask.who.names if not unfit(n, ask, self.world, self.before)]


def backfill_commands(
    stands: StandingAssets, goals: Moves, *, others_stay: bool, late: bool
) -> Iterator[Commands]:
    """Yield added commands that keep gates covered and unknown tracks observed, best first.

    With `late`, an asset may take over a gate even if it arrives after the grace time. Nothing is
    yielded if no asset can do this, or if commands are needed but the other assets have to stay
    (`others_stay`).
    """
    needs = [*_bare(stands, goals, late=late), *_unseen(stands, goals)]
    if not needs:
        yield ()
    elif not others_stay:
        yield from _came(stands, goals, needs, late=late)


def _came(
    stands: StandingAssets, goals: Moves, needs: Sequence[str], *, late: bool
) -> Iterator[Commands]:
    """Yield the commands that bring one asset to each place in `needs`."""
    if not needs:
        if not [*_bare(stands, goals, late=late), *_unseen(stands, goals)]:
            yield ()
        return
    place, *others = needs
    command, names = _helpers(stands, goals, place, late=late)
    for name in names[:_MOST_RELIEFS]:
        for rest in _came(stands, {**goals, name: place}, others, late=late):
            yield ((name, command), *rest)


def _helpers(
    stands: StandingAssets, goals: Moves, place: str, *, late: bool
) -> tuple[str, list[str]]:
    """Return the command that sends an asset to `place`, and the candidates for the command."""
    spare = [n for n in stands.free() if n not in goals and not _is_last(stands, n, goals)]
    if _is_unseen(stands, goals, place):
        return f"observe {place}", [name for name in spare if stands.kind(name) == "uav"]
    soonest = sorted(spare, key=lambda name: _way_s(stands, name, place))
    return f"move_to {place}", [n for n in soonest if late or _is_in_time(stands, n, place)]


def _bare(stands: StandingAssets, goals: Moves, *, late: bool) -> Iterator[str]:
    """Yield each gate that all its guards leave and that no other asset reaches in time."""
    for gate in stands.world.gates:
        guards = stands.guards(gate)
        if not guards or any(goals.get(name, gate) == gate for name in guards):
            continue
        coming = [name for name, goal in goals.items() if goal == gate]
        if not any(late or _is_in_time(stands, name, gate) for name in coming):
            yield gate


def _unseen(stands: StandingAssets, goals: Moves) -> Iterator[str]:
    """Yield each place with an unobserved track to which only ground assets go."""
    yield from (p for p in dict.fromkeys(goals.values()) if _is_unseen(stands, goals, p))


def _is_unseen(stands: StandingAssets, goals: Moves, place: str) -> bool:
    unknown = any(t.identity == "unknown" and not t.observed for t in stands.tracks(place))
    coming = [name for name, goal in goals.items() if goal == place != stands.post(name)]
    flown = any(stands.kind(name) == "uav" for name, goal in goals.items() if goal == place)
    watched = any(name not in goals for name in stands.there(place, "uav"))
    return unknown and bool(coming) and not flown and not watched


def in_turn(plan: Plan, before: Picture, world: World) -> Plan | None:
    """Return `plan` with every asset staying at its gate until those that relieve it have arrived.

    Returns None if no asset relieves another one at a gate, if the plan has several steps already,
    or if assets would wait for each other.
    """
    posts = {name: asset.post for name, asset in before.assets.items()}
    coming: dict[str, list[int]] = {}
    for number, action in enumerate(plan.actions, start=1):
        goal = goes_to(action, world)
        if goal in world.gates and posts.get(action.agent) != goal:
            coming.setdefault(goal, []).append(number)
    actions = list[Action]()
    for action in plan.actions:
        gate = posts.get(action.agent) or ""
        leaves = goes_to(action, world) not in ("", gate)
        after = tuple(coming.get(gate, ())) if leaves else ()
        actions.append(action.model_copy(update={"after": after}) if after else action)
    if len(plan.steps) > 1 or tuple(actions) == plan.actions:
        return None
    try:
        return Plan(reason=plan.reason, actions=tuple(actions))
    except ValueError:
        return None


def bare_s(stands: StandingAssets, goals: Moves) -> float:
    """Return the total time, in seconds, for which gates without guards wait for a new guard."""
    left = (
        [_way_s(stands, name, gate) for name, goal in goals.items() if goal == gate]
        for gate in stands.world.gates
        if (guards := stands.guards(gate)) and all(goals.get(n, gate) != gate for n in guards)
    )
    return sum(min(coming, default=math.inf) for coming in left)


def but_guards(stands: StandingAssets, names: Sequence[str], place: str) -> Iterator[str]:
    """Yield `names`, but not the last guard of any gate except `place`: it stays (WF-03)."""
    left = {gate: [*stands.guards(gate)] for gate in stands.world.gates if gate != place}
    for name in names:
        gate = stands.post(name)
        if left.get(gate) != [name]:
            yield name
            if name in left.get(gate, ()):
                left[gate].remove(name)


def _is_last(stands: StandingAssets, name: str, goals: Moves) -> bool:
    """Return whether `name` covers a gate that all its other guards leave."""
    gate = stands.post(name)
    guards = stands.guards(gate)
    return name in guards and all(goals.get(g, gate) != gate for g in guards if g != name)


def _is_in_time(stands: StandingAssets, name: str, gate: str) -> bool:
    """Return whether an asset can reach `gate` within the grace time, even with a detour."""
    return _DETOUR * _way_s(stands, name, gate) <= stands.world.coverage_grace_s


def _way_s(stands: StandingAssets, name: str, gate: str) -> float:
    """Return the shortest time in which an asset can reach a gate, in seconds."""
    way = math.dist(stands.before.assets[name].position, stands.world.frames[gate].at)
    return way / stands.world.platforms[stands.kind(name)].speed_mps
