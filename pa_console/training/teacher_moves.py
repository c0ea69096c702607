"""Drafts for asks that move assets: go, look, cover, relieve, swap, home, stand down, mass."""

from collections.abc import Sequence
from itertools import islice

from pa_console.orchestrator.digest import KINDS
from pa_console.schema.world import AssetKind
from pa_console.training.order import Ask
from pa_console.training.teacher_draft import Desk, Draft, going, refusal
from pa_console.training.teacher_objections import asset_objection
from pa_console.training.teacher_roster import Roster

MOST_OPTIONS = 4
"""So many ways to serve one ask are tried at most."""


def go(ask: Ask, desk: Desk, roster: Roster) -> list[Draft]:
    """Send those named, or the first free of the kind, to the place; some may have to stay."""
    world = roster.world
    if ask.who.names:
        able, why = named(ask, desk, roster)
        commands = tuple(going(name, ask.place, world) for name in able)
        said = _said(able, why, roster)
        whole = Draft(only(ask, able), commands, said, undone=bool(why))
        return [whole, *fewer(whole, roster)]
    return [
        Draft(
            so_many(ask, team),
            tuple(going(name, ask.place, world) for name in team),
            (roster.offered(team, short=short),),
            undone=short,
            rule="CAP-10" if short else "",
        )
        for team, short in teams(ask, desk, roster, _kinds(ask))
    ] or [refusal(ask, none_free(ask), "CAP-10")]


def look(ask: Ask, desk: Desk, roster: Roster) -> list[Draft]:
    """Let drones observe the place: those named, else a spare, else one that stands there."""
    if ask.who.names:
        able, why = named(ask, desk, roster)
        commands = tuple((name, f"observe {ask.place}") for name in able)
        said = _said(able, why, roster)
        return [Draft(only(ask, able), commands, said, undone=bool(why))]
    here = [n for n in roster.there(ask.place, ("uav",)) if roster.clear(n)]
    spare = [n for n in teams(ask, desk, roster, ("uav",)) if all(map(roster.clear, n[0]))]
    at_hand = [((name,), False) for name in here if name not in desk.taken()]
    found = at_hand + spare if ask.who.kind is None else spare + at_hand
    return [
        Draft(
            so_many(ask, team),
            tuple((name, f"observe {ask.place}") for name in team),
            (f"{ask.place}: {team[0]}" if team[0] in here else roster.offered(team, short=short),),
            undone=short,
            rule="CAP-10" if short else "",
        )
        for team, short in found
    ] or [refusal(ask, "Free drone: none", "CAP-10")]


def cover(ask: Ask, desk: Desk, roster: Roster) -> list[Draft]:
    """Send a guard: those named, else a free drone, vehicle or robot, in this order."""
    lost = ask.leaving
    place = ask.place or (roster.picture.assets[lost].post or "" if lost else "")
    if not place:
        return [refusal(ask, "no gate has lost it", "CAP-10")]
    note = [f"{lost}: down"] if lost and not roster.up(lost) else []
    found = _guards(ask, desk, roster, place)
    return [
        Draft(
            ask.model_copy(update={"place": place}),
            (going(name, place, roster.world),),
            (", ".join([*note, roster.offered([name])]),),
        )
        for name in found
    ] or [refusal(ask, "nobody is free", "CAP-10")]


def relieve(ask: Ask, desk: Desk, roster: Roster) -> list[Draft]:
    """Send a guard to where one is that goes home; one that is down only needs the other."""
    lost = ask.leaving
    place = ask.place or roster.picture.assets[lost].post or ""
    if not roster.up(lost):
        return cover(ask, desk, roster)
    if not place or place == roster.world.base:
        return [refusal(ask, f"{lost} guards no place", "CAP-10")]
    low = f"{lost}: low, " if roster.low(lost) else ""
    return [
        Draft(
            ask.model_copy(update={"place": place}),
            (
                going(name, place, roster.world),
                (lost, "return_to_base"),
            ),
            (f"{low}{roster.offered([name])} takes over",),
        )
        for name in _guards(ask, desk, roster, place)
    ] or [refusal(ask, f"nobody is free for {place}", "WF-03")]


def swap(ask: Ask, desk: Desk, roster: Roster) -> list[Draft]:
    """Send each of the two to where the other stands."""
    first, second = ask.who.names
    posts = [roster.picture.assets[name].post or "" for name in (first, second)]
    if not all(posts) or posts[0] == posts[1] or {first, second} & desk.used:
        return [refusal(ask, "they cannot change places", "CAP-10")]
    moves = going(first, posts[1], roster.world), going(second, posts[0], roster.world)
    return [Draft(ask, moves, (f"{posts[0]} and {posts[1]} stay covered",))]


def home(ask: Ask, desk: Desk, roster: Roster) -> list[Draft]:
    """Send home those named, else those of the kind that are low, else the first free ones."""
    base = roster.world.base
    if ask.who.names:
        able, why = named(ask, desk, roster)
        commands = tuple((name, "return_to_base") for name in able)
        said = _said(able, why, roster)
        whole = Draft(only(ask, able), commands, said, undone=bool(why))
        return [whole, *fewer(whole, roster)]
    low = [
        name
        for name in roster.digest.low_battery
        if roster.kind(name) in _kinds(ask)
        and roster.stands(name) != base
        and (not ask.who.origin or roster.stands(name) == ask.who.origin)
        and name not in desk.taken()
    ]
    if low and ask.who.count == 1:
        return [
            Draft(ask, ((name, "return_to_base"),), (f"{name}: low",))
            for name in low[:MOST_OPTIONS]
        ]
    going_home = ask.model_copy(update={"place": base})
    return [
        Draft(
            so_many(ask, team),
            tuple((name, "return_to_base") for name in team),
            (roster.offered(team, short=short),),
            undone=short,
            rule="CAP-10" if short else "",
        )
        for team, short in teams(going_home, desk, roster, _kinds(ask))
    ] or [refusal(ask, none_free(ask), "CAP-10")]


def stand_down(ask: Ask, desk: Desk, roster: Roster) -> list[Draft]:
    """Send home everybody at the place but the first one that the picture lists there."""
    there = [name for name in roster.every() if roster.stands(name) == ask.place]
    sound = [name for name in there if not roster.low(name)] or there
    leaving = [name for name in there if name not in {*sound[:1], *desk.used}]
    if not leaving:
        why = f"only {there[0]} is there" if there else "nobody is there"
        return [Draft(ask, why=(why,))]
    commands = tuple((name, "return_to_base") for name in leaving)
    return [Draft(ask, commands, (f"{sound[0]} stays",))]


def mass(ask: Ask, desk: Desk, roster: Roster) -> list[Draft]:
    """Send all free assets of the kind that no gate needs; guards stay (WF-03, WF-06)."""
    every = ask.model_copy(update={"who": ask.who.model_copy(update={"count": "all"})})
    team = next((team for team, _ in teams(every, desk, roster, _kinds(ask))), ())
    if not team:
        return [refusal(ask, none_free(ask), "CAP-10")]
    shorter = [team, *([team[: len(team) // 2]] if len(team) > 3 else [])]
    return [
        Draft(
            ask,
            tuple(going(name, ask.place, roster.world) for name in some),
            (f"{roster.offered(some)}, guards stay",),
        )
        for some in shorter
    ]


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


def _guards(ask: Ask, desk: Desk, roster: Roster, place: str) -> list[str]:
    """Return who could guard `place`: those named, else the free ones in the order of use."""
    own = (*ask.who.names, ask.leaving)
    if ask.who.names:
        return [
            name
            for name in ask.who.names
            if asset_objection(name, ask, roster) is None and name not in desk.used
        ][:1]
    kinds = _kinds(ask)
    if ask.who.kind is not None and not ask.strict_who:
        kinds = tuple(sorted(KINDS, key=lambda kind: kind != ask.who.kind))
    pool = roster.free(kinds, desk.taken(own), ask.who.origin)
    fit = (n for n in pool if n != ask.leaving and roster.stands(n) != place)
    spare = [n for n in fit if not roster.bare({n: place})]
    first = [n for n in spare if roster.clear(n)]
    order = sorted(spare, key=lambda n: (n not in first, kinds.index(roster.kind(n))))
    return list(islice(order, MOST_OPTIONS))


def _said(able: Sequence[str], why: Sequence[str], roster: Roster) -> tuple[str, ...]:
    """Return why some cannot, then the states of those who can."""
    return (*why, roster.told(able)) if able else tuple(why)


def _kinds(ask: Ask) -> tuple[AssetKind, ...]:
    return KINDS if ask.who.kind is None else (ask.who.kind,)
