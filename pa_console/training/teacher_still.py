"""Drafts for asks that move nobody: report and hold."""

from pa_console.training.order import Ask
from pa_console.training.teacher_draft import Desk, Draft, listed, refusal
from pa_console.training.teacher_roster import Roster
from pa_console.training.teacher_teams import named, none_free, only


def report(ask: Ask, desk: Desk, roster: Roster) -> list[Draft]:
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


def hold(ask: Ask, desk: Desk, roster: Roster) -> list[Draft]:
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
