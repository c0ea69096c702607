"""What must be true of a run for an order to have been carried out: CEL conditions over `run`.

They are written from the meaning of the order alone and share nothing with how plans are made.
"""

from collections.abc import Iterator, Sequence

from pa_console.language.canonical.order import Ask, Task
from pa_console.schema.command import Verb
from pa_console.schema.world import World

STAYS = ("run.refused", "size(run.moved) == 0")
"""Nothing was ordered but hold and report, and nobody has moved."""
COVERED = (
    "run.gates.all(g, !run.coverage[g].at_start || (run.coverage[g].at_end"
    " && run.coverage[g].longest_gap_s <= run.grace_s + 1.0))"
)
"""Gates that were covered stay so but for the grace time (WF-03)."""
_TAKES_OVER = (
    "run.gates.exists(g, run.final.assets[n].at == g"
    " && run.moved.exists(m, m != n && m in run.start.gates[g].by))"
)
_ESCALATION = (
    "run.tracks.all(t, t.warned_s <= 0.0"
    " || (t.identified_s >= 0.0 && t.identified_s <= t.warned_s))",
    "run.tracks.all(t, t.blocked_s < 0.0 || (t.intent == 'hostile' && t.warned_s >= 0.0"
    " && t.warned_s <= t.blocked_s))",
)
_MEETS: frozenset[Task] = frozenset(("identify", "warn", "block", "respond"))


def conditions(asks: Sequence[Ask], world: World, *, others_stay: bool = False) -> tuple[str, ...]:
    """Return the conditions for the asks of an order that are to be served; none mean to hold."""
    moving = [ask for ask in asks if ask.task not in ("report", "hold")]
    wanted = [text for ask in asks for text in _ask(ask, world)]
    if not moving:
        return tuple(dict.fromkeys((*wanted, *STAYS)))
    movers = [text for ask in moving for text in _may_move(ask, world)]
    if not others_stay:
        movers.append(_TAKES_OVER)
        movers += [_at("n", ask.place, "uav") for ask in moving if ask.place in world.gates]
    movers += [_met(ask.place) for ask in moving if ask.place in world.gates]
    allowed = " || ".join(dict.fromkeys(movers)) or "false"
    wanted += [f"run.moved.all(n, {allowed})", COVERED]
    wanted += [_dealt_with(ask.place) for ask in moving if ask.task in _MEETS]
    if any(ask.task in _MEETS for ask in asks):
        wanted += _ESCALATION
    else:
        met = " || ".join(f"a.frame == '{ask.place}'" for ask in moving if ask.place in world.gates)
        wanted.append(
            f"run.actions.all(a, !(a.verb in ['block', 'warn', 'identify']) || {met or 'false'})"
        )
    return tuple(dict.fromkeys(wanted))


def _ask(ask: Ask, world: World) -> Iterator[str]:
    """Yield what one ask wants to be true."""
    place = ask.place
    match ask.task:
        case "go" | "mass" | "home":
            yield from _there(ask, world)
        case "look":
            yield from _there(ask, world, verb="observe")
            if place in world.gates:
                yield _seen(place)
        case "identify":
            known = f"{_some(place)} (t.identified_s >= 0.0 || t.noncombatants))"
            yield f"{_nobody_known(place)} || {known}"
            yield _seen(place)
            if ask.who.names:
                yield f"{_nobody_known(place)} || {_sent(place, ask)}"
        case "warn":
            yield (
                f"{_nobody_known(place)} || {_some(place)} (t.warned_s >= 0.0 || t.noncombatants"
                " || t.identity == 'authorized' || t.status == 'leaving'))"
            )
        case "block":
            yield (
                f"{_ordered('block', place, ask)} || run.tracks.exists(t, t.gate == '{place}'"
                " && !(t.intent == 'hostile' && t.warned_s >= 0.0))"
            )
        case "respond":
            yield _seen(place)
            yield (
                f"run.tracks.all(t, t.gate != '{place}' || t.contact_s < 0.0"
                " || (t.observed_s >= 0.0 && t.observed_s <= t.contact_s))"
            )
        case "cover":
            yield f"run.final.gates['{place}'].covered" if place in world.gates else _fed(place)
            yield f"run.moved.exists(n, n != '{ask.leaving}' && {_at('n', place)})"
        case "relieve":
            yield _at_name(ask.leaving, world.base)
            yield f"run.moved.exists(n, n != '{ask.leaving}' && {_at('n', place)})"
        case "swap":
            first, second = ask.who.names
            for one, other in ((first, second), (second, first)):
                yield (
                    f"run.final.assets['{one}'].at == run.start.assets['{other}'].post"
                    f" && run.final.assets['{one}'].available"
                )
        case "stand_down":
            yield (
                f"size(run.final.gates['{place}'].by) == 1" if place in world.gates else _fed(place)
            )
            yield f"run.moved.exists(n, {_at('n', world.base)})"
        case "report":
            yield from (f"'{name}' in run.reports" for name in ask.who.names)
            yield from _reporters(ask)
        case "hold":
            yield from (f"!('{name}' in run.moved)" for name in ask.who.names)
        case "refused" | "unreadable":
            pass


def _there(ask: Ask, world: World, verb: Verb | None = None) -> Iterator[str]:
    """Yield that those who were asked to be somewhere are there, and sound."""
    place = world.base if ask.task == "home" else ask.place
    for name in ask.who.names:
        yield _at_name(name, place)
    if ask.who.names:
        return
    kind = "uav" if verb == "observe" else ask.who.kind
    if verb is None:
        count = 1 if ask.task == "mass" or ask.who.count == "all" else ask.who.count
        fit = f"{_at('n', place, kind)}{_from('n', ask)}"
        least = f"size(run.moved.filter(n, {fit})) >= {count}"
        yield least
        if ask.task == "go" and kind != "uav":
            yield f"size(run.moved.filter(n, {_at('n', place, kind)})) <= {count}"
    else:
        yield (
            f"run.actions.exists(a, a.verb == '{verb}' && a.frame == '{place}' && a.done"
            f" && run.final.assets[a.agent].at == '{place}'{_from('a.agent', ask)})"
        )


def _may_move(ask: Ask, world: World) -> Iterator[str]:
    """Yield who may have moved for the ask: an expression over the name `n`."""
    place, names = ask.place, [*ask.who.names, *([ask.leaving] if ask.leaving else [])]
    if names:
        yield f"n in [{', '.join(repr(name) for name in names)}]"
    match ask.task:
        case "go" | "mass" if not ask.who.names:
            yield _at("n", place, ask.who.kind)
        case "home" if not ask.who.names:
            yield _at("n", world.base, ask.who.kind)
        case "look":
            yield _at("n", place, "uav")
        case "cover" | "relieve":
            yield f"run.final.assets[n].at == '{place}'"
        case "stand_down":
            yield (
                f"run.final.assets[n].at == '{world.base}' && run.start.assets[n].post == '{place}'"
            )
        case "identify" | "warn" | "block" | "respond":
            yield f"run.actions.exists(a, a.agent == n && a.frame == '{place}')"
            yield _at("n", place, "uav")
        case _:
            pass


def _reporters(ask: Ask) -> Iterator[str]:
    """Yield who must have reported when nobody was named."""
    if ask.who.names:
        return
    kind, place, origin = ask.who.kind, ask.place, ask.who.origin
    parts = [f"run.start.assets[n].kind == '{kind}'"] if kind else []
    parts += [f"run.start.assets[n].post == '{at}'" for at in (place, origin) if at]
    fit = " && ".join(parts) or "true"
    if ask.who.count == "all" or place:
        yield (
            "run.start.assets.all(n, !run.start.assets[n].available"
            f" || !({fit}) || n in run.reports)"
        )
    else:
        yield f"size(run.reports.filter(n, {fit})) >= {ask.who.count}"


def _at(name: str, place: str, kind: str | None = None) -> str:
    """Return that the asset in the variable `name` is at `place`, and of the kind if given."""
    there = f"run.final.assets[{name}].at == '{place}' && run.final.assets[{name}].available"
    return f"{there} && run.final.assets[{name}].kind == '{kind}'" if kind else there


def _from(name: str, ask: Ask) -> str:
    """Return that the asset in the variable `name` came from where `ask` wants it from, if said."""
    origin = ask.who.origin
    return f" && run.start.assets[{name}].post == '{origin}'" if origin else ""


def _at_name(name: str, place: str) -> str:
    asset = f"run.final.assets['{name}']"
    return f"{asset}.at == '{place}' && {asset}.available"


def _fed(place: str) -> str:
    """Return that somebody is at a place that is no gate."""
    return f"run.final.assets.exists(n, {_at('n', place)})"


def _met(place: str) -> str:
    """Return that `n` was sent to deal with a track at `place`, which workflows may do (WF-01)."""
    return (
        f"run.tracks.exists(t, t.gate == '{place}') && run.actions.exists(a, a.agent == n"
        f" && a.frame == '{place}' && a.verb in ['observe', 'identify', 'warn', 'block'])"
    )


def _dealt_with(place: str) -> str:
    """Return that somebody was sent to look at, or to deal with, whoever is at `place`."""
    return (
        f"run.actions.exists(a, !a.rejected && a.frame == '{place}' && ((a.kind == 'uav' &&"
        " a.verb in ['observe', 'move_to']) || a.verb in ['identify', 'warn', 'block']))"
    )


def _seen(place: str) -> str:
    return f"run.tracks.all(t, t.gate != '{place}' || !t.present || t.observed_s >= 0.0)"


def _nobody_known(place: str) -> str:
    return f"!run.tracks.exists(t, t.gate == '{place}')"


def _some(place: str) -> str:
    return f"run.tracks.exists(t, t.gate == '{place}' &&"


def _sent(place: str, ask: Ask) -> str:
    names = ", ".join(repr(name) for name in ask.who.names)
    return f"run.actions.exists(a, a.frame == '{place}' && a.agent in [{names}])"


def _ordered(verb: Verb, place: str, ask: Ask) -> str:
    who = f" && a.agent in [{', '.join(repr(n) for n in ask.who.names)}]" if ask.who.names else ""
    return f"run.actions.exists(a, a.verb == '{verb}' && a.frame == '{place}' && a.done{who})"
