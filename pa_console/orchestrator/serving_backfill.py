"""Who takes over the gates that the commands of an order would leave without a guard (WF-03)."""

import math
from collections.abc import Iterator, Sequence

from pa_console.llm.slot_grammar import Slot
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.policy.context import goes_to
from pa_console.schema.plan import Action


class UntoldError(Exception):
    """What serves a wish depends on more than the picture tells."""


def backfills(stands: PlanMoves, asked: Sequence[Slot], others_stay: bool) -> Iterator[Slot]:
    """Yield who takes over each gate that all its guards would leave too long (WF-03).

    Who is sent there anyway takes over, unless that is later than the gate's grace. Raises
    UntoldError where somebody has to and all others are to stay.
    """
    ways = [(s, goes_to(Action(agent=s.agents[0], command=s.command), stands.world)) for s in asked]
    leaving = {slot.agents[0]: goal for slot, goal in ways if len(slot.agents) == 1 and goal}
    away = [name for name, goal in leaving.items() if goal != stands.post(name)]
    free = [n for n in stands.free() if n not in leaving and not _is_last(stands, n, away)]
    for gate in stands.world.gates:
        guards, others = stands.guards(gate), free
        if coming := [name for slot, goal in ways if goal == gate for name in slot.agents]:
            others = [name for name in free if _is_in_time(stands, name, gate)]
        stays = any(leaving.get(name, gate) == gate for name in guards)
        if not guards or stays or any(_is_in_time(stands, name, gate) for name in coming):
            continue
        if others or not coming:
            if others_stay:
                raise UntoldError
            yield Slot(_in_time(stands, among(stands, others), gate), f"move_to {gate}")


def but_guards(stands: PlanMoves, names: Sequence[str], place: str) -> Iterator[str]:
    """Yield `names` without the last guard of each gate but `place`, who stays (WF-03)."""
    left = {gate: [*stands.guards(gate)] for gate in stands.world.gates if gate != place}
    for name in names:
        gate = stands.post(name)
        if left.get(gate) != [name]:
            yield name
            if name in left.get(gate, ()):
                left[gate].remove(name)


def _is_last(stands: PlanMoves, name: str, away: Sequence[str]) -> bool:
    """Whether all other guards of the gate that `name` covers go away."""
    guards = stands.guards(stands.post(name))
    return name in guards and all(guard in away for guard in guards if guard != name)


def _in_time(stands: PlanMoves, names: Sequence[str], gate: str) -> tuple[str, ...]:
    """Return those of `names` who can be at `gate` before its grace is over, or the two soonest."""
    soonest = sorted(names, key=lambda name: _way_s(stands, name, gate))[:2]
    return tuple(n for n in names if n in soonest or _is_in_time(stands, n, gate))


def _is_in_time(stands: PlanMoves, name: str, gate: str) -> bool:
    return _way_s(stands, name, gate) <= stands.world.coverage_grace_s


def _way_s(stands: PlanMoves, name: str, gate: str) -> float:
    """Return how long an asset needs at least to be at a gate, in seconds."""
    way = math.dist(stands.before.assets[name].position, stands.world.frames[gate].at)
    return way / stands.world.platforms[stands.kind(name)].speed_mps


def among(stands: PlanMoves, names: Sequence[str], elsewhere: str = "") -> tuple[str, ...]:
    """Return those of `names` who do not stand `elsewhere`; raises UntoldError for nobody."""
    found = tuple(name for name in names if not elsewhere or stands.post(name) != elsewhere)
    if not found:
        raise UntoldError
    return found
