"""The further commands of a plan: gates stay covered, and unknown tracks are observed.

An asset that leaves a gate as its last guard is replaced (WF-03), and leaves after its replacement
has arrived if the gap would be too long. A ground asset goes to an unknown track only if a drone
observes it (WF-02).
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
"""The number of candidates that are tried for the takeover of one gate, the soonest first."""
_DETOUR = 1.2
"""The assumed length of a way, as a multiple of the straight one."""

Moves = Mapping[str, str]
"""Destinations by agent, each the name of a frame."""
Commands = tuple[tuple[str, str], ...]
"""Agents with their commands."""


@dataclass(frozen=True)
class StandingAssets(PlanMoves):
    """The posts of all assets before a plan; `named` are the assets that the order names."""

    named: frozenset[str] = frozenset()

    def free(self, kind: AssetKind | None = None) -> list[str]:
        """Return the assets that could be sent, of `kind` if given, but not the named assets."""
        return [name for name in super().free(kind) if name not in self.named]

    def near(self, place: str, kind: AssetKind) -> tuple[str, ...]:
        """Return the unnamed assets of `kind` at `place`, then the free assets of that kind."""
        there = (name for name in self.there(place, kind) if name not in self.named)
        return tuple(dict.fromkeys((*there, *self.free(kind))))

    def fit(self, ask: Ask) -> list[str]:
        """Return the assets that `ask` names and that can do their part of it."""
        return [n for n in ask.who.names if not unfit(n, ask, self.world, self.before)]


def backfill_commands(
    stands: StandingAssets, goals: Moves, *, others_stay: bool, late: bool
) -> Iterator[Commands]:
    """Yield the further commands that keep gates covered and unknown tracks observed, best first.

    With `late`, the asset that arrives first may take over a gate even after its grace time.
    Nothing is yielded if that is impossible, or if it would need assets that the order keeps in
    place.
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
    """Return the command for an asset to go to `place`, and the candidates for it."""
    spare = [n for n in stands.free() if n not in goals and not _is_last(stands, n, goals)]
    if _is_unseen(stands, goals, place):
        return f"observe {place}", [name for name in spare if stands.kind(name) == "uav"]
    soonest = sorted(spare, key=lambda name: _way_s(stands, name, place))
    return f"move_to {place}", [n for n in soonest if late or _is_in_time(stands, n, place)]


def _bare(stands: StandingAssets, goals: Moves, *, late: bool) -> Iterator[str]:
    """Yield each gate that all its guards leave and that no asset reaches in time."""
    for gate in stands.world.gates:
        guards = stands.guards(gate)
        if not guards or any(goals.get(name, gate) == gate for name in guards):
            continue
        coming = [name for name, goal in goals.items() if goal == gate]
        if not any(late or _is_in_time(stands, name, gate) for name in coming):
            yield gate


def _unseen(stands: StandingAssets, goals: Moves) -> Iterator[str]:
    """Yield each place to which only ground assets go although an unobserved track is there."""
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
    """Return the total time that deserted gates wait for a new guard, in seconds."""
    left = (
        [_way_s(stands, name, gate) for name, goal in goals.items() if goal == gate]
        for gate in stands.world.gates
        if (guards := stands.guards(gate)) and all(goals.get(n, gate) != gate for n in guards)
    )
    return sum(min(coming, default=math.inf) for coming in left)


def but_guards(stands: StandingAssets, names: Sequence[str], place: str) -> Iterator[str]:
    """Yield `names` without the last guard of each gate, who stays (WF-03), except at `place`."""
    left = {gate: [*stands.guards(gate)] for gate in stands.world.gates if gate != place}
    for name in names:
        gate = stands.post(name)
        if left.get(gate) != [name]:
            yield name
            if name in left.get(gate, ()):
                left[gate].remove(name)


def _is_last(stands: StandingAssets, name: str, goals: Moves) -> bool:
    """Return whether all other guards of the gate that `name` covers leave it."""
    gate = stands.post(name)
    guards = stands.guards(gate)
    return name in guards and all(goals.get(g, gate) != gate for g in guards if g != name)


def _is_in_time(stands: StandingAssets, name: str, gate: str) -> bool:
    """Return whether an asset can reach `gate` within the grace time, with a detour."""
    return _DETOUR * _way_s(stands, name, gate) <= stands.world.coverage_grace_s


def _way_s(stands: StandingAssets, name: str, gate: str) -> float:
    """Return the least time that an asset needs to reach a gate, in seconds."""
    way = math.dist(stands.before.assets[name].position, stands.world.frames[gate].at)
    return way / stands.world.platforms[stands.kind(name)].speed_mps
