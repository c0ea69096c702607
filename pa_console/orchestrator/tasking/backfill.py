"""Additional assets for a plan: takeovers (WF-03) and a first look (WF-02)."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from pa_console.language.order import Ask
from pa_console.llm.roles.grammar import CommandSlot
from pa_console.orchestrator.planning.plan_moves import PlanMoves
from pa_console.orchestrator.tasking.obstacles import unfit
from pa_console.schema.world import AssetKind


class NotInPictureError(Exception):
    """The plan for an ask depends on more than the picture shows."""


class CommandUnit(NamedTuple):
    """Commands that serve a part of an order, all of them or none."""

    slots: tuple[CommandSlot, ...]
    ahead: bool = False
    """The looks at places without a known contact: given up before any other part."""


@dataclass(frozen=True)
class StandingAssets(PlanMoves):
    """The places of all assets before a plan for an order that names those in `named`."""

    named: frozenset[str] = frozenset()

    def free(self, kind: AssetKind | None = None) -> list[str]:
        """Return who could be sent somewhere, of one kind if that is given, but for those named."""
        return [name for name in super().free(kind) if name not in self.named]

    def near(self, place: str, kind: AssetKind) -> tuple[str, ...]:
        """Return the assets of a kind at a place, then the free ones; no named ones."""
        there = (name for name in self.there(place, kind) if name not in self.named)
        return tuple(dict.fromkeys((*there, *self.free(kind))))

    def fit(self, ask: Ask) -> list[str]:
        """Return the assets that `ask` names and that can do their part of it."""
        return [n for n in ask.who.names if not unfit(n, ask, self.world, self.before)]


def units_of_one(slots: Iterable[CommandSlot]) -> Iterator[CommandUnit]:
    """Yield every slot as a unit of its own."""
    yield from (CommandUnit((slot,)) for slot in slots)


def one_unit(slots: Iterable[CommandSlot]) -> Iterator[CommandUnit]:
    """Yield one unit of all slots, if there are any."""
    if every := tuple(slots):
        yield CommandUnit(every)


_MOST_RELIEFS = 3
"""Ways in which one gate is taken over that are looked at, the soonest first."""

_DETOUR = 1.2
"""The allowed length of a way, as a multiple of the straight one."""
Moves = Mapping[str, str]
"""Destinations by agent: agent -> frame."""
Commands = tuple[tuple[str, str], ...]
"""Agents with their commands."""


def backfill_commands(
    stands: StandingAssets, goals: Moves, *, others_stay: bool, late: bool
) -> Iterator[Commands]:
    """Yield the commands that keep every gate covered and unknown tracks seen first, best first.

    With `late`, a gate may be taken over by whoever is there soonest, though that is after its
    grace by the straight way. Nothing is yielded where there is no way, or one that would need
    others of whom the order says that they stay.
    """
    needs = [*_bare(stands, goals, late=late), *_unseen(stands, goals)]
    if not needs:
        yield ()
    elif not others_stay:
        yield from _came(stands, goals, needs, late=late)


def _came(
    stands: StandingAssets, goals: Moves, needs: Sequence[str], *, late: bool
) -> Iterator[Commands]:
    """Yield who comes to the places in `needs`, one for each."""
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
    """Return the command for the asset that comes to `place`, and the candidates for it."""
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
    """Yield each place to which only ground assets go although an unseen track is there."""
    yield from (p for p in dict.fromkeys(goals.values()) if _is_unseen(stands, goals, p))


def _is_unseen(stands: StandingAssets, goals: Moves, place: str) -> bool:
    unknown = any(t.identity == "unknown" and not t.observed for t in stands.tracks(place))
    coming = [name for name, goal in goals.items() if goal == place != stands.post(name)]
    flown = any(stands.kind(name) == "uav" for name, goal in goals.items() if goal == place)
    watched = any(name not in goals for name in stands.there(place, "uav"))
    return unknown and bool(coming) and not flown and not watched


def bare_s(stands: StandingAssets, goals: Moves) -> float:
    """Return how long the gates that all their guards leave wait for a new guard, in seconds."""
    left = (
        [_way_s(stands, name, gate) for name, goal in goals.items() if goal == gate]
        for gate in stands.world.gates
        if (guards := stands.guards(gate)) and all(goals.get(n, gate) != gate for n in guards)
    )
    return sum(min(coming, default=math.inf) for coming in left)


def but_guards(stands: StandingAssets, names: Sequence[str], place: str) -> Iterator[str]:
    """Yield `names` without the last guard of each gate but `place`, who stays (WF-03)."""
    left = {gate: [*stands.guards(gate)] for gate in stands.world.gates if gate != place}
    for name in names:
        gate = stands.post(name)
        if left.get(gate) != [name]:
            yield name
            if name in left.get(gate, ()):
                left[gate].remove(name)


def _is_last(stands: StandingAssets, name: str, goals: Moves) -> bool:
    """Return whether all other guards of the gate that `name` covers go away."""
    gate = stands.post(name)
    guards = stands.guards(gate)
    return name in guards and all(goals.get(g, gate) != gate for g in guards if g != name)


def _is_in_time(stands: StandingAssets, name: str, gate: str) -> bool:
    """Return whether an asset can reach `gate` within its grace time, with a detour."""
    return _DETOUR * _way_s(stands, name, gate) <= stands.world.coverage_grace_s


def _way_s(stands: StandingAssets, name: str, gate: str) -> float:
    """Return how long an asset needs at least to be at a gate, in seconds."""
    way = math.dist(stands.before.assets[name].position, stands.world.frames[gate].at)
    return way / stands.world.platforms[stands.kind(name)].speed_mps
