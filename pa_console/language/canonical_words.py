"""The canonical words of orders: for what one asks, and for what a plan does.

The word order is fixed (`clauses.py`) and the names are the world's own, so that a small model
first says what it has understood. Text that is no order of the operator leaves no trace in it.
"""

from collections.abc import Iterable, Iterator, Sequence

from pa_console.language.clauses import (
    ASIDE,
    CLAUSES,
    EXCEPT,
    NOTHING,
    NOWHERE,
    OTHERS_STAY,
    TEAM,
    UNLAWFUL,
    counted,
    written,
)
from pa_console.language.condition import in_words
from pa_console.language.digest_facts import evidence
from pa_console.language.order import ANYBODY, TASK_OF, Ask, Order, Who
from pa_console.language.picture_facts import is_so
from pa_console.schema.plan import Action
from pa_console.schema.telemetry import Digest, Picture
from pa_console.schema.world import KINDS, PLAIN_KINDS, World

MOST_NAMED = 4
"""More assets than these with one task are only counted."""


def planned(actions: Sequence[Action], world: World, *, by_name: bool) -> str:
    """Return what the actions do, e.g. "1 drone to EastGate; Robot_T01 home" with names if asked.

    A plan in which one asset holds and nothing else happens is "hold".
    """
    if [action.verb for action in actions] == ["hold"] and not by_name:
        return "hold"
    tasks: dict[str, list[Action]] = {}
    for action in actions:
        tasks.setdefault(action.command, []).append(action)
    return "; ".join(_task(group, world, by_name) for group in tasks.values()) or NOTHING


def _task(actions: Sequence[Action], world: World, by_name: bool) -> str:
    names = [action.agent for action in actions]
    who = ", ".join(names) if by_name and len(names) <= MOST_NAMED else _counted(names, world)
    target = actions[0].target
    where = {"place": target, "gate": target} if target else {}
    return written(TASK_OF[actions[0].verb], {"who": who, **where})


def _counted(names: Iterable[str], world: World) -> str:
    kinds = [world.assets[name].kind for name in names]
    return ", ".join(
        TEAM.write(counted(kind, kinds.count(kind))) for kind in KINDS if kind in kinds
    )


_REFUSED = frozenset(clause.wrong for clause in CLAUSES if clause.wrong is not None)
"""The faults that leave no other part of the ask to write."""
_OF_TRACKS = frozenset(clause.task for clause in CLAUSES if "{track}" in clause.words.text)
"""The tasks that can be put with the name of a track."""


def canonical_order(order: Order, world: World, picture: Picture, digest: Digest) -> str:
    """Return what `order` asks, with its condition and how that stands, e.g. "hold; report"."""
    words = _depending(order, world)
    if order.condition is not None:
        so = "so" if is_so(order.condition, picture) else "not so"
        words = f"{words}; now: {evidence(order.condition, digest)}, {so}"
    return _of_others(order, words)


def canonical_meaning(order: Order, world: World) -> str:
    """Return what `order` asks, whatever the picture is, e.g. "if A: hold, else: nothing"."""
    return _of_others(order, _depending(order, world))


def canonical_clause(ask: Ask, world: World) -> str:
    """Return one ask in words; what is wrong with it is said where the names alone do not."""
    if ask.wrong in _REFUSED:
        return written("refused", dict(_said(ask, world)), ask.wrong)
    words = written(ask.task, dict(_said(ask, world)))
    if ask.wrong == ASIDE.wrong:
        return ASIDE.words + words
    return words + next((each.words for each in UNLAWFUL if each.wrong == ask.wrong), "")


def _depending(order: Order, world: World) -> str:
    """Return everything that is asked, under its condition if there is one."""
    words = _all(order.asks, world)
    if order.condition is None:
        return words
    otherwise = _all(order.otherwise, world) if order.otherwise else NOTHING
    return f"if {in_words(order.condition)}: {words}, else: {otherwise}"


def _of_others(order: Order, words: str) -> str:
    if order.excluded:
        words = f"{words}; {EXCEPT}{', '.join(order.excluded)}"
    return f"{words}; {OTHERS_STAY}" if order.others_stay else words


def _all(asks: tuple[Ask, ...], world: World) -> str:
    return "; ".join(canonical_clause(ask, world) for ask in asks)


def _said(ask: Ask, world: World) -> Iterator[tuple[str, str]]:
    """Yield the content of an ask for the slots of clauses, by the slot."""
    place = ask.place if ask.place in world.frames or ask.place in world.zones else NOWHERE
    if ask.place:
        yield "place", place
    if ask.task == "swap":
        yield from zip(("first", "second"), ask.who.names, strict=True)
    elif who := _who(ask.who):
        yield "who", who
    if ask.task == "mass" and ask.who.kind is not None:
        yield "massed", f"{PLAIN_KINDS[ask.who.kind]}s"
    if ask.leaving:
        yield "guard", f"{ask.leaving} at {place}" if ask.place else ask.leaving
    if ask.track_id and ask.task in _OF_TRACKS:
        yield "track", f"{ask.track_id} at {place}"
    elif ask.place:
        yield "gate", place
    if ask.track:
        yield "thing", ask.track
        yield "stranger", f" {ask.track}"


def _who(who: Who) -> str:
    """Return the assets of an ask, '' when they are left open."""
    if who.names:
        return ", ".join(who.names)
    if who == ANYBODY:
        return ""
    said = {"origin": who.origin} if who.origin else {}
    if who.kind is None:
        return TEAM.write({**said, "every": "all" if who.count == "all" else "any"})
    return TEAM.write({**said, **counted(who.kind, who.count)})
