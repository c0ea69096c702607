"""Whom a plan needs besides those that an order sends: takeovers and a look ahead from the air.

A gate that loses its only guard gets another one in the same plan (WF-03); ground assets that go to
an unknown track get a drone that sees it before them (WF-02).
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

from pa_console.orchestrator.digest import KINDS
from pa_console.training.order import Ask
from pa_console.training.teacher_draft import Command, Desk, Draft, goals, going
from pa_console.training.teacher_moves import look
from pa_console.training.teacher_roster import Roster

MOST_FILLERS = 4


class Filled(NamedTuple):
    """Commands that are added to a plan, and why."""

    commands: tuple[Command, ...] = ()
    why: tuple[str, ...] = ()


def bare_gates(drafts: Sequence[Draft], roster: Roster) -> tuple[str, ...]:
    """Return the gates that the drafts leave without anybody."""
    return roster.bare(goals(_commands(drafts), roster.world))


def unseen_places(drafts: Sequence[Draft], roster: Roster) -> tuple[str, ...]:
    """Return the places to which only ground assets go although a track there is unseen."""
    ends = goals(_commands(drafts), roster.world)
    found: list[str] = []
    for name, place in ends.items():
        seen = any(roster.kind(other) == "uav" for other, at in ends.items() if at == place)
        committed = roster.kind(name) != "uav" and roster.picture.assets[name].post != place
        watched = any(n not in ends for n in roster.there(place, ("uav",)))
        if committed and not seen and not watched and roster.unseen(place):
            found.append(place)
    return tuple(dict.fromkeys(found))


def fillings(drafts: Sequence[Draft], roster: Roster, reserved: frozenset[str]) -> Iterator[Filled]:
    """Yield ways to keep every gate covered and every unknown track seen first, best first.

    Nothing is yielded when there is none.
    """
    ends = goals(_commands(drafts), roster.world)
    busy = frozenset(agent for draft in drafts for agent in draft.agents) | reserved
    yield from islice(_looks_first(drafts, ends, busy, roster), MOST_FILLERS * 2)


def relays(drafts: Sequence[Draft], roster: Roster, reserved: frozenset[str]) -> Iterator[Filled]:
    """Yield additional drones for gates whose next guard comes over the ground, and so too late."""
    ends = goals(_commands(drafts), roster.world)
    busy = frozenset(agent for draft in drafts for agent in draft.agents) | reserved
    for gate, cover in roster.picture.gates.items():
        left = cover.covered and all(ends.get(name, gate) != gate for name in cover.by)
        flown = any(at == gate and roster.kind(n) == "uav" for n, at in ends.items())
        if not left or flown:
            continue
        for drone in roster.free(("uav",), busy):
            if not roster.bare({**ends, drone: gate}):
                order = going(drone, gate, roster.world)
                yield Filled((order,), (f"{drone} fills the gap at {gate} (WF-03)",))


def _looks_first(
    drafts: Sequence[Draft], ends: Mapping[str, str], busy: frozenset[str], roster: Roster
) -> Iterator[Filled]:
    """Yield takeovers together with the looks from the air that are needed."""
    for taken_over in _takeovers(ends, busy, roster):
        used = busy | {agent for agent, _ in taken_over.commands}
        looks = Filled()
        for place in unseen_places(drafts, roster):
            drafted = look(Ask(task="look", place=place), Desk(used=used), roster)
            drone = next((d.agents[0] for d in drafted if d.agents), "")
            if not drone:
                return
            used |= {drone}
            why = f"{drone} looks first (WF-02)"
            looks = Filled((*looks.commands, (drone, f"observe {place}")), (*looks.why, why))
        yield Filled((*taken_over.commands, *looks.commands), (*taken_over.why, *looks.why))


def _takeovers(ends: Mapping[str, str], busy: frozenset[str], roster: Roster) -> Iterator[Filled]:
    """Yield a guard for every gate that would be bare: free drones before other free assets."""
    bare = roster.bare(ends)
    if not bare:
        yield Filled()
        return
    gate = bare[0]
    leaver = next(n for n in roster.picture.gates[gate].by if ends.get(n, gate) != gate)
    alone = roster.alone_at(leaver) == gate
    left = f"{leaver}: alone at {gate} (WF-03)" if alone else f"nobody stays at {gate} (WF-03)"
    pool = [n for n in roster.free(KINDS, busy) if roster.stands(n) != gate]
    tried = 0
    for name in pool:
        after = {**ends, name: gate}
        if len(roster.bare(after)) >= len(bare):
            continue
        order = going(name, gate, roster.world)
        why = f"{left}, {roster.offered([name])} takes over"
        for rest in _takeovers(after, busy | {name}, roster):
            yield Filled((order, *rest.commands), (why, *rest.why))
        tried += 1
        if tried >= MOST_FILLERS:
            return


def _commands(drafts: Sequence[Draft]) -> list[Command]:
    return [command for draft in drafts for command in draft.commands]
