"""Drafts for asks that move assets, and for those that move nobody: report and hold."""

from dataclasses import replace

from pa_console.language.canonical.order import Ask, Who
from pa_training.teacher.roster import (
    MOST_OPTIONS,
    Draft,
    Roster,
    TakenAssets,
    fewer,
    going,
    guards,
    kinds_of,
    listed,
    named,
    none_free,
    only,
    refusal,
    said_of,
    so_many,
    teams,
)


def report(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Let those named report, else those at the place or of the kind, else everybody."""
    if ask.who.names:
        able, why = named(ask, desk, roster)
        return [_each(ask, able, "report", roster, why)]
    pool = [n for n in roster.every() if n not in desk.used]
    if ask.place:
        pool = [n for n in pool if roster.stands(n) == ask.place]
        if not pool:
            return [refusal(ask, f"nobody is at {ask.place}", "CAP-10")]
        return [_each(ask, pool, "report", roster, (f"{ask.place}: {listed(pool)}",))]
    if ask.who.kind is not None:
        pool = [n for n in pool if roster.kind(n) == ask.who.kind]
    if ask.who.origin:
        pool = [n for n in pool if roster.stands(n) == ask.who.origin]
    if ask.who.count != "all" and (ask.who.kind is not None or ask.who.origin):
        spare = [n for n in roster.free(roster.digest.free) if n in pool]
        pool = [*spare, *(n for n in pool if n not in spare)][: ask.who.count]
    return (
        [_each(ask, pool, "report", roster)] if pool else [refusal(ask, none_free(ask), "CAP-10")]
    )


def hold(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Let those named stay where they are, or all of a kind; else nobody is to do anything."""
    if ask.who.names:
        able, why = named(ask, desk, roster)
        return [_each(ask, able, "hold", roster, why)]
    if ask.who.kind is None and ask.who.count != "all":
        return [Draft(ask, why=("nothing to do",))]
    pool = [
        name
        for name in roster.every()
        if name not in desk.used
        and (ask.who.kind is None or roster.kind(name) == ask.who.kind)
        and (not ask.who.origin or roster.stands(name) == ask.who.origin)
    ]
    if ask.who.count != "all":
        pool = pool[: ask.who.count]
    return [_each(ask, pool, "hold", roster)] if pool else [refusal(ask, none_free(ask), "CAP-10")]


def _each(
    ask: Ask, names: list[str], command: str, roster: Roster, why: tuple[str, ...] = ()
) -> Draft:
    effective = only(ask, names) if ask.who.names else ask
    commands = tuple((name, command) for name in names)
    undone = bool(why) and bool(ask.who.names)
    return Draft(effective, commands, why or (roster.told(names),), undone=undone)


def go(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Send those named, or the first free of the kind, to the place; some may have to stay."""
    world = roster.world
    if ask.who.names:
        able, why = named(ask, desk, roster)
        commands = tuple(going(name, ask.place, world) for name in able)
        said = said_of(able, why, roster)
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
        for team, short in teams(ask, desk, roster, kinds_of(ask))
    ] or [refusal(ask, none_free(ask), "CAP-10")]


def look(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Let drones observe the place: those named, else a spare, else one that stands there."""
    if ask.who.names:
        able, why = named(ask, desk, roster)
        commands = tuple((name, f"observe {ask.place}") for name in able)
        said = said_of(able, why, roster)
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


def cover(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Send a guard: those named, else a free drone, vehicle or robot, in this order."""
    lost = ask.leaving
    place = ask.place or (roster.picture.assets[lost].post or "" if lost else "")
    if not place:
        return [refusal(ask, "no gate has lost it", "CAP-10")]
    note = [f"{lost}: down"] if lost and not roster.up(lost) else []
    found = guards(ask, desk, roster, place)
    return [
        Draft(
            replace(ask, place=place),
            (going(name, place, roster.world),),
            (", ".join([*note, roster.offered([name])]),),
        )
        for name in found
    ] or [refusal(ask, "nobody is free", "CAP-10")]


def relieve(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Send a guard to where one is that goes home; one that is down only needs the other.

    Nobody is sent where all of those who could come stand there already.
    """
    lost = ask.leaving
    place = ask.place or roster.picture.assets[lost].post or ""
    if not roster.up(lost):
        return cover(ask, desk, roster)
    if not place or place == roster.world.base:
        return [refusal(ask, f"{lost} guards no place", "CAP-10")]
    if lost in desk.used:
        return [refusal(ask, f"{lost} has one task already", "CAP-07")]
    coming, there = guards(ask, desk, roster, place), _standing(ask, desk, roster, place)
    if there and not any(roster.kind(name) in kinds_of(ask) for name in coming):
        leaves = Ask(task="home", who=Who(names=(lost,)))
        why = f"{roster.whereabouts(lost)}, {there[0]} stays"
        return [Draft(leaves, ((lost, "return_to_base"),), (why,))]
    return [
        Draft(
            replace(ask, place=place),
            (
                going(name, place, roster.world),
                (lost, "return_to_base"),
            ),
            (f"{roster.whereabouts(lost)}, {roster.offered([name])} takes over",),
        )
        for name in coming
    ] or [refusal(ask, f"nobody is free for {place}", "WF-03")]


def _standing(ask: Ask, desk: TakenAssets, roster: Roster, place: str) -> list[str]:
    """Return who could relieve somebody at `place` and stands there already."""
    if ask.who.names:
        return []
    free = roster.free(kinds_of(ask), (*desk.taken(), ask.leaving), ask.who.origin)
    return [name for name in free if roster.stands(name) == place]


def swap(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Send each of the two to where the other stands."""
    first, second = ask.who.names
    posts = [roster.picture.assets[name].post or "" for name in (first, second)]
    if not all(posts) or posts[0] == posts[1] or {first, second} & desk.used:
        return [refusal(ask, "they cannot change places", "CAP-10")]
    moves = going(first, posts[1], roster.world), going(second, posts[0], roster.world)
    return [Draft(ask, moves, (f"{roster.whereabouts(first)}, {roster.whereabouts(second)}",))]


def home(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Send home those named, else those of the kind that are low, else the first free ones."""
    base = roster.world.base
    if ask.who.names:
        able, why = named(ask, desk, roster)
        commands = tuple((name, "return_to_base") for name in able)
        said = said_of(able, why, roster)
        whole = Draft(only(ask, able), commands, said, undone=bool(why))
        return [whole, *fewer(whole, roster)]
    low = [
        name
        for name in roster.digest.low_battery
        if roster.kind(name) in kinds_of(ask)
        and roster.stands(name) != base
        and (not ask.who.origin or roster.stands(name) == ask.who.origin)
        and name not in desk.taken()
    ]
    if low and ask.who.count == 1:
        return [
            Draft(ask, ((name, "return_to_base"),), (f"{name}: low",))
            for name in low[:MOST_OPTIONS]
        ]
    going_home = replace(ask, place=base)
    return [
        Draft(
            so_many(ask, team),
            tuple((name, "return_to_base") for name in team),
            (roster.offered(team, short=short),),
            undone=short,
            rule="CAP-10" if short else "",
        )
        for team, short in teams(going_home, desk, roster, kinds_of(ask))
    ] or [refusal(ask, none_free(ask), "CAP-10")]


def stand_down(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Send home everybody at the place but the first one that the picture lists there."""
    there = [name for name in roster.every() if roster.stands(name) == ask.place]
    sound = [name for name in there if not roster.low(name)] or there
    leaving = [name for name in there if name not in {*sound[:1], *desk.used}]
    if len(there) < 2:
        return [Draft(ask, why=(f"only {there[0]} is there" if there else "nobody is there",))]
    commands = tuple((name, "return_to_base") for name in leaving)
    return [Draft(ask, commands, (f"{ask.place}: {listed(there)}, {sound[0]} stays",))]


def mass(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Send all free assets of the kind that no gate needs; guards stay (WF-03, WF-06)."""
    every = replace(ask, who=replace(ask.who, count="all"))
    team = next((team for team, _ in teams(every, desk, roster, kinds_of(ask))), ())
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
