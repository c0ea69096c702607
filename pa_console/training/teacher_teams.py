"""Who takes part in what is asked: those named, or teams of free assets, best first."""

from collections.abc import Sequence
from itertools import islice

from pa_console.orchestrator.digest import KINDS
from pa_console.schema.world import AssetKind
from pa_console.training.order import Ask
from pa_console.training.teacher_draft import Desk, Draft
from pa_console.training.teacher_objections import asset_objection
from pa_console.training.teacher_roster import Roster

MOST_OPTIONS = 4
"""So many ways to serve one ask are tried at most."""


def named(ask: Ask, desk: Desk, roster: Roster) -> tuple[list[str], tuple[str, ...]]:
    """Return who of those named can do it, and in words why the others cannot."""
    able: list[str] = []
    why: list[str] = []
    for name in ask.who.names:
        problem = asset_objection(name, ask, roster)
        if problem is not None:
            why.append(f"{problem[0]} ({problem[1]})")
        elif name in desk.used:
            why.append(f"{name} has one task already (CAP-07)")
        else:
            able.append(name)
    return able, tuple(why)


def teams(
    ask: Ask, desk: Desk, roster: Roster, kinds: Sequence[AssetKind]
) -> list[tuple[tuple[str, ...], bool]]:
    """Return teams of free assets for the place, best first, and whether they are too few.

    Nobody is in one whose leaving would leave a gate bare, nor who stands there already.
    """
    pool = [
        name
        for name in roster.free(kinds, desk.taken(), ask.who.origin)
        if roster.stands(name) != ask.place
    ]
    wanted = len(pool) if ask.who.count == "all" else ask.who.count
    found: list[tuple[tuple[str, ...], bool]] = []
    for start in range(min(len(pool), MOST_OPTIONS)):
        team: list[str] = []
        for name in (*pool[start:], *pool[:start]):
            if not roster.bare(dict.fromkeys((*team, name), ask.place)) and len(team) < wanted:
                team.append(name)
        chosen = tuple(name for name in pool if name in team)
        if team and (chosen, len(team) < wanted) not in found:
            found.append((chosen, len(team) < wanted and ask.who.count != "all"))
    return found


def only(ask: Ask, names: Sequence[str]) -> Ask:
    """Return `ask` for those of its assets that can do it."""
    return ask.model_copy(update={"who": ask.who.model_copy(update={"names": tuple(names)})})


def fewer(draft: Draft, roster: Roster) -> list[Draft]:
    """Return `draft` without one of several that a gate depends on, each in turn (WF-03)."""
    return [
        Draft(
            only(draft.ask, [name for name in draft.agents if name != stays]),
            tuple(command for command in draft.commands if command[0] != stays),
            (*draft.why, f"{stays}: alone at {gate} (WF-03) stays"),
            undone=True,
        )
        for stays in draft.agents
        if len(draft.agents) > 1 and not draft.ask.strict_who and (gate := roster.alone_at(stays))
    ]


def so_many(ask: Ask, team: Sequence[str]) -> Ask:
    """Return `ask` for as many assets as there are in `team`."""
    return ask.model_copy(update={"who": ask.who.model_copy(update={"count": len(team)})})


def none_free(ask: Ask) -> str:
    """Return in words that nobody of the kind that is asked for is free."""
    words = {"uav": "drone", "ugv": "vehicle", "robot": "robot"}
    return f"Free {words[ask.who.kind]}: none" if ask.who.kind is not None else "nobody is free"


def guards(ask: Ask, desk: Desk, roster: Roster, place: str) -> list[str]:
    """Return who could guard `place`: those named, else the free ones in the order of use."""
    own = (*ask.who.names, ask.leaving)
    if ask.who.names:
        return [
            name
            for name in ask.who.names
            if asset_objection(name, ask, roster) is None and name not in desk.used
        ][:1]
    kinds = kinds_of(ask)
    if ask.who.kind is not None and not ask.strict_who:
        kinds = tuple(sorted(KINDS, key=lambda kind: kind != ask.who.kind))
    pool = roster.free(kinds, desk.taken(own), ask.who.origin)
    fit = (n for n in pool if n != ask.leaving and roster.stands(n) != place)
    spare = [n for n in fit if not roster.bare({n: place})]
    first = [n for n in spare if roster.clear(n)]
    order = sorted(spare, key=lambda n: (n not in first, kinds.index(roster.kind(n))))
    return list(islice(order, MOST_OPTIONS))


def said_of(able: Sequence[str], why: Sequence[str], roster: Roster) -> tuple[str, ...]:
    """Return why some cannot, then the states of those who can."""
    return (*why, roster.told(able)) if able else tuple(why)


def kinds_of(ask: Ask) -> tuple[AssetKind, ...]:
    """Return the kinds of assets that may serve `ask`."""
    return KINDS if ask.who.kind is None else (ask.who.kind,)
